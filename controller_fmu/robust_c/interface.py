"""The variables of the robust LQG: the weights of two designs, and how it switches between them."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from controller_fmu.lqg.flexible_manipulator_lqg.interface import CONNECTORS, POSITIVE, Pair, Weights, parameters


class Switching(NamedTuple):
    """What an event is, and what it switches on; annotations as in flexible_manipulator_lqg/interface.py."""

    amplitude: Annotated[Pair, "N.m", "Torque of the dither at full strength, if the headroom allows it", 0.0]
    period: Annotated[float, "s", "Period of the dither, a square wave", POSITIVE]
    headroom: Annotated[float, "1", "Loop gain at which the dither and the torque at rest stay within the limit", 1.0]
    off: Annotated[float, "m", "Level of the TCP error below which the controller at rest acts alone", 0.0]
    rise: Annotated[float, "m", "From that level to the one with full strength", POSITIVE]
    memory: Annotated[float, "s", "Time constant with which the level fades", POSITIVE]
    threshold: Annotated[float, "m", "Jump of the stretched arm's estimated TCP error that may be an event", 0.0]
    contrast: Annotated[float, "1", "An event's error relative to its slow average", 0.0]
    jump_time: Annotated[float, "s", "Time constant of the average error that a jump is counted from", POSITIVE]
    average_time: Annotated[float, "s", "Time constant of the average", POSITIVE]
    fatigue: Annotated[float, "s", "Time constant with which the largest jump of an event fades", POSITIVE]
    sway: Annotated[float, "m", "Slow motion of the stretched arm's estimated TCP that the dither follows", POSITIVE]
    sway_share: Annotated[float, "1", "Part of the dither's strength for a sway", 0.0]
    wait: Annotated[float, "s", "Time from an event until its feedback begins; after twice that it has all", POSITIVE]
    hold: Annotated[float, "s", "Time after an event for which the full strength is allowed", 0.0]
    decay: Annotated[float, "s", "Time in which what is allowed then falls to nothing", POSITIVE]


EVENT = tuple(
    row._replace(
        name=f"event_{row.name}", description=f"After an event: {row.description[0].lower()}{row.description[1:]}"
    )
    for row in parameters(Weights)
)
ROWS = (*CONNECTORS, *parameters(Weights), *EVENT, *parameters(Switching))
"""The variables in the order of their value references."""
