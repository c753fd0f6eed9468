"""Units: values are in SI units everywhere, and are shown in the units of the paper."""

from __future__ import annotations

import math
from typing import NamedTuple


class Unit(NamedTuple):
    """An SI unit, and the name and factor of the unit that its values are shown in."""

    si: str
    shown: str
    factor: float = 1.0


NONE = Unit("", "")
MILLIMETRE, MICROMETRE = Unit("m", "mm", 1e3), Unit("m", "µm", 1e6)
SECOND, MILLISECOND = Unit("s", "s"), Unit("s", "ms", 1e3)
TORQUE, HERTZ, RADIAN = Unit("N.m", "Nm"), Unit("Hz", "Hz"), Unit("rad", "rad")
DEGREE = Unit("rad", "°", 180.0 / math.pi)

SHOWN = {"": NONE, "m": MILLIMETRE, "N.m": TORQUE, "s": SECOND, "Hz": HERTZ, "rad": RADIAN}
"""How values are shown, by SI unit, where nothing else is said."""


def number(value: float | None, factor: float = 1.0, exact: bool = False) -> str:
    """``value`` times ``factor`` with three significant figures, four from 100 on, seven if it is ``exact``, which a
    sixteenth of a sample has in milliseconds; a dash if there is no value."""
    if value is None:
        return "-"
    if exact:
        return f"{value * factor:.7g}"
    return f"{value * factor:.3g}" if abs(value * factor) < 100 else f"{value * factor:.1f}"


def amplitude(metres: float | None) -> str:
    """A limit cycle with its unit: in micrometres, from 1 mm on in millimetres; a dash if there is none."""
    if metres is None:
        return number(metres)
    unit = MILLIMETRE if abs(metres) >= 1e-3 else MICROMETRE
    return f"{number(metres, unit.factor)} {unit.shown}"


def heading(name: str, unit: Unit) -> str:
    """A name with the unit that its values are shown in, such as ``B5 [mm]``."""
    return f"{name} [{unit.shown}]" if unit.shown else name


def si_heading(name: str, unit: Unit) -> str:
    """The same with the SI unit, for files."""
    return f"{name} [{unit.si}]" if unit.si else name
