"""The variables of the robust LQG: the weights of three designs, and how it switches between them."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from controller_fmu.lqg.flexible_manipulator_lqg.interface import (
    CONNECTORS,
    POSITIVE,
    Pair,
    Variable,
    Weights,
    parameters,
)


class Switching(NamedTuple):
    """What an event is, and what it switches on; annotations as in flexible_manipulator_lqg/interface.py."""

    amplitude: Annotated[Pair, "N.m", "Torque of the dither at full strength, if the headroom allows it", 0.0]
    period: Annotated[float, "s", "Period of the dither, a square wave", POSITIVE]
    headroom: Annotated[float, "1", "Loop gain at which the dither and the torque at rest stay within the limit", 1.0]
    off: Annotated[float, "m", "Level of the TCP error below which the controller at rest acts alone", 0.0]
    rise: Annotated[float, "m", "From that level to the one with full strength", POSITIVE]
    memory: Annotated[float, "s", "Time constant with which the level fades", POSITIVE]
    threshold: Annotated[float, "m", "Motion of the stretched arm's estimated TCP above which is an event", 0.0]
    contrast: Annotated[float, "1", "Smallest ratio of an event's motion to the average of the motion", 0.0]
    average_time: Annotated[float, "s", "Time constant of the averages of error, motion and jumps", POSITIVE]
    dithered: Annotated[float, "1", "Factor of the threshold while the dither acts", 1.0]
    spent: Annotated[float, "1", "Factor of the threshold once the time of the dither is spent", 1.0]
    dither_time: Annotated[float, "s", "Time for which the dither acts in all before it is spent", 0.0]
    sway: Annotated[float, "m", "Motion of the stretched arm's estimated TCP that keeps the dither on", 0.0]
    sway_share: Annotated[float, "1", "Part of the dither's strength for that motion", 0.0]
    wait: Annotated[float, "s", "Time from an event until its feedback begins; after twice that it has all", POSITIVE]
    hold: Annotated[float, "s", "Time after an event for which the full strength is allowed", 0.0]
    decay: Annotated[float, "s", "Time in which what is allowed then falls to nothing", POSITIVE]
    jump: Annotated[float, "m", "Jump of the stretched arm's TCP error in the third filter that begins a peak", 0.0]
    jump_contrast: Annotated[float, "1", "Smallest ratio of such a jump to the average of the jumps", 0.0]
    jump_time: Annotated[float, "s", "Time constant of the average error that a jump is counted from", POSITIVE]
    peak_hold: Annotated[float, "s", "Time for which the third law then acts alone", 0.0]
    peak_decay: Annotated[float, "s", "Time in which it gives way to the others", POSITIVE]
    peak_time: Annotated[float, "s", "Time for which the third law may act before it has to rest", 0.0]
    peak_regain: Annotated[float, "1", "Part of the time that is given back to it", 0.0]


class Slow(NamedTuple):
    """What acts while the LQGs would stay in the drive's limits."""

    overload: Annotated[float, "1", "Share of the samples at a limit above which the slow feedback acts", POSITIVE]
    overload_time: Annotated[float, "s", "Time constant of the average of that share", POSITIVE]
    recovered: Annotated[float, "1", "Share of the samples below which the LQGs act again", 0.0]
    slow_stiffness: Annotated[Pair, "N.m/rad", "Stiffness of the slow feedback of the motor angles", 0.0]
    slow_damping: Annotated[Pair, "N.m.s/rad", "Damping of the slow feedback", 0.0]
    slow_share: Annotated[float, "1", "Largest share of the limit that its stiffness asks for", 0.0]
    velocity_time: Annotated[float, "s", "Time constant of its velocity", POSITIVE]
    peak_pause: Annotated[float, "s", "Time after it for which the third law rests", 0.0]


def weights_for(prefix: str, when: str) -> tuple[Variable, ...]:
    """The weights of a further design, which acts ``when`` something happened."""
    return tuple(
        row._replace(
            name=f"{prefix}{row.name}", description=f"{when}: {row.description[0].lower()}{row.description[1:]}"
        )
        for row in parameters(Weights)
    )


SLOW = parameters(Slow)

ROWS = (
    *CONNECTORS,
    *parameters(Weights),
    *weights_for("event_", "After an event"),
    *weights_for("peak_", "In a first peak"),
    *parameters(Switching),
    *SLOW,
)
"""The variables in the order of their value references."""
