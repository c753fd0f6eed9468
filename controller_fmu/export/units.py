"""FMI unit definitions from the spelling of a unit: ``N.m/(rad.s)`` is kg m2 s-3 rad-1."""

from __future__ import annotations

import re
from collections import Counter

from controller_fmu.export.archive import BuildError

# Exponents of FMI's base units; a unit is spelled with '.' for times, one '/', and trailing exponents.
_BASE: dict[str, dict[str, int]] = {
    "1": {},
    "kg": {"kg": 1},
    "m": {"m": 1},
    "s": {"s": 1},
    "rad": {"rad": 1},
    "N": {"kg": 1, "m": 1, "s": -2},
    "Hz": {"s": -1},
}
_FACTOR = re.compile(r"(1|[A-Za-z]+)(\d*)")
_ORDER = ("kg", "m", "s", "rad")


def base_exponents(unit: str) -> dict[str, int]:
    """Return the non-zero exponents of the base units of ``unit``: ``{"m": 1, "s": -2}`` for ``"m/s2"``.

    Raises:
        BuildError: the spelling is not understood.
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
                known = ", ".join(_BASE)
                raise BuildError(
                    f"unit {unit!r}: factor {factor!r} is unknown; spell the unit with {known} "
                    f"(like 'N.m/(rad.s)'), or add the factor to {__name__}"
                )
            for base, exponent in _BASE[match[1]].items():
                exponents[base] += sign * exponent * int(match[2] or 1)
    return {base: exponents[base] for base in _ORDER if exponents[base]}
