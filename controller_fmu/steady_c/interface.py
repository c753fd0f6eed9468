"""The variables of SteadyLQG: RobustLQG's without what limits a part in time or keeps the dither on, and its own."""

from __future__ import annotations

from typing import Annotated, NamedTuple

from controller_fmu.lqg.flexible_manipulator_lqg.interface import POSITIVE, parameters
from controller_fmu.robust_c.interface import ROWS as ROBUST_ROWS
from controller_fmu.robust_c.interface import SLOW

LEFT_OUT = ("off", "rise", "memory", "wait", "spent", "dither_time", "sway", "sway_share", "peak_time", "peak_regain")


class Ringing(NamedTuple):
    """What else begins an event, and how one stands out; annotations as in flexible_manipulator_lqg/interface.py."""

    contrast_time: Annotated[float, "s", "Time constant with which the average of the motion rises", POSITIVE]
    event_rise: Annotated[float, "s", "Time in which the second law takes over from the first after an event", POSITIVE]
    ringing: Annotated[float, "m", "Average motion of the estimated TCP above which one that dies out is an event", 0.0]
    ringing_fall: Annotated[float, "1", "Ratio of its fast average to its slow one below which a motion dies out", 0.0]
    ringing_time: Annotated[float, "s", "Time constant of the fast average", POSITIVE]
    ringing_memory: Annotated[float, "s", "Time constant of the slow average", POSITIVE]
    ringing_rise: Annotated[float, "s", "Time constant with which the slow average rises", POSITIVE]


OWN = tuple(row for row in ROBUST_ROWS if row.name not in LEFT_OUT and row not in SLOW)

ROWS = (*OWN, *parameters(Ringing), *SLOW)
"""The variables in the order of their value references."""
