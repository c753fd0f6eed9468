"""FMI unit definitions from the spelling of a unit: ``N.m/(rad.s)`` is kg m2 s-3 rad-1."""

from __future__ import annotations

import difflib
import re
from collections import Counter

from controller_fmu.errors import UnitError

BASE_UNITS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")
"""FMI's base units, in its order."""

COMMON = ("1", "s", "Hz", "m", "N", "rad", "rad/s", "N.m", "N.m/rad", "N.m.s/rad", "N.m/(rad.s)")
"""Units of controllers, offered where a unit is not understood."""

# Exponents of the base units; a unit is spelled with '.' for times, one '/', and trailing exponents.
_BASE: dict[str, dict[str, int]] = {
    "1": {},
    **{base: {base: 1} for base in BASE_UNITS},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Hz": {"s": -1},
}
_FACTOR = re.compile(r"(1|[A-Za-z]+)(\d*)")


def base_exponents(unit: str) -> dict[str, int]:
    """Return the non-zero exponents of the base units of ``unit``: ``{"m": 1, "s": -2}`` for ``"m/s2"``.

    Raises:
        UnitError: the spelling is not understood.
    """
    numerator, slash, denominator = unit.partition("/")
    exponents: Counter[str] = Counter()
    products = [(1, numerator)]
    if slash:
        products.append((-1, denominator.removeprefix("(").removesuffix(")")))
    for sign, product in products:
        for factor in product.split("."):
            match = _FACTOR.fullmatch(factor)
            if match is None or match[1] not in _BASE:
                near = tuple(difflib.get_close_matches(unit, COMMON, n=2))
                raise UnitError(f"the unit {unit!r} has the unknown factor {factor!r}", value=unit, nearest=near)
            for base, exponent in _BASE[match[1]].items():
                exponents[base] += sign * exponent * int(match[2] or 1)
    return {base: exponents[base] for base in BASE_UNITS if exponents[base]}
