"""Units: the factor from an FMU's declared unit to a connector's, from a given one to the FMU's, by base units."""

from __future__ import annotations

import functools
import math
from collections.abc import Iterable
from dataclasses import dataclass
from typing import NamedTuple

from fmpy.model_description import ModelDescription, Unit

from ..errors import InputError

EXPONENTS = ("kg", "m", "s", "A", "K", "mol", "cd", "rad")


@dataclass(frozen=True)
class Dimension:
    """A unit as ``factor`` times a product of base units; ``exponents`` in the order of ``EXPONENTS``.

    ``offset`` is where its zero is, in base units.
    """

    factor: float
    exponents: tuple[int, ...]
    offset: float = 0.0


def _of(factor: float = 1.0, **exponents: int) -> Dimension:
    return Dimension(factor, tuple(exponents.get(name, 0) for name in EXPONENTS))


KNOWN: dict[str, Dimension] = {
    **dict.fromkeys(("rad", "radian"), _of(rad=1)),
    **dict.fromkeys(("deg", "degree", "°"), _of(math.pi / 180, rad=1)),
    **dict.fromkeys(("N.m", "Nm", "N*m", "N m", "N·m"), _of(kg=1, m=2, s=-2)),
    **dict.fromkeys(("mN.m", "mNm", "mN*m"), _of(1e-3, kg=1, m=2, s=-2)),
    **dict.fromkeys(("kN.m", "kNm", "kN*m"), _of(1e3, kg=1, m=2, s=-2)),
    "N": _of(kg=1, m=1, s=-2),
    "m": _of(m=1),
    **dict.fromkeys(("s", "sec"), _of(s=1)),
    "ms": _of(1e-3, s=1),
    "1": _of(),
}
"""Units that are understood by name if an FMU does not define them."""

ROUNDED = 1e-3
"""How far the factors of two units of one name may be apart: exporters round them."""


class Conversion(NamedTuple):
    """``value in the connector's unit = factor * value in the FMU``; ``note`` says what could not be checked."""

    factor: float
    note: str = ""


@functools.lru_cache(maxsize=256)  # asked for again in each simulation
def conversion(description: ModelDescription, unit: str | None, connector_unit: str, where: str) -> Conversion:
    """The conversion from ``unit``, as declared in an FMU, to ``connector_unit``.

    Raises :class:`InputError` if the two are of different kind or the declared one cannot be understood. An angle
    may also be declared dimensionless, as in SI.
    """
    if unit is None:
        return Conversion(1.0, f"{where} declares no unit; taken as {connector_unit}")
    source, target = _dimension(unit, description.unitDefinitions, where), KNOWN[connector_unit]
    # CATIA-Systems/FMPy#865: an offset is for temperatures. An angle with
    # another zero would shift q_m, and a factor alone cannot say that.
    if source is not None and source.offset:
        message = (
            f"{where} has the unit {unit!r}, whose zero is not that of {connector_unit} (offset {source.offset:g})."
        )
        raise InputError(f"{message} Declare it in {connector_unit}.", "unit-offset", where, unit)
    if source is None:
        if unit == connector_unit:
            return Conversion(1.0)
        message = f"{where} has the unit {unit!r}, which the FMU does not define by base units. Declare it in "
        raise InputError(f"{message}{connector_unit}, or give its definition a BaseUnit.", "unknown-unit", where, unit)
    if source.exponents != target.exponents:
        # In SI the radian is 1, and many exporters have no base unit rad (FMI 1.0 has none).
        if any(source.exponents) or target != KNOWN["rad"]:
            message = f"{where} has the unit {unit!r}, which is not convertible to {connector_unit}."
            raise InputError(f"{message} Connect it to another variable.", "wrong-unit", where, unit)
        return Conversion(source.factor / target.factor, f"{where}: the unit {unit!r} counts radians as dimensionless")
    return Conversion(1.0 if source.factor == target.factor else source.factor / target.factor)


def factor_to_fmu_unit(
    description: ModelDescription, fmu_unit: str | None, given: str, definitions: Iterable[Unit], where: str
) -> float:
    """The factor from a value in the unit ``given`` to one in ``fmu_unit``.

    ``definitions`` come with the value and override the FMU's for ``given``. Raises :class:`InputError` if the two
    cannot be compared or are of different kind.
    """
    source = _dimension(given, [*definitions, *description.unitDefinitions], where)
    named = _dimension(given, description.unitDefinitions, where)
    alike = source is not None and named is not None and source.exponents == named.exponents
    if source and named and alike and not math.isclose(source.factor, named.factor, rel_tol=ROUNDED):
        message = (
            f"{where} is given in {given!r}, which the file defines with the factor {source.factor:g}, and the FMU "
        )
        message += f"or its name with {named.factor:g}. Give the unit another name."
        raise InputError(message, "bad-unit", where, given)
    target = _dimension(fmu_unit, description.unitDefinitions, where) if fmu_unit is not None else None
    if source is None or target is None:
        if given == fmu_unit:
            return 1.0
        message = (
            f"{where} is given in {given!r}, which cannot be compared to the FMU's unit for it, {fmu_unit or 'none'}: "
        )
        message += "one of them is not defined by base units. Give the value in the FMU's unit, and no unit with it."
        raise InputError(message, "unknown-unit", where, given)
    if source.offset != target.offset or source.exponents[:-1] != target.exponents[:-1]:  # gains may leave out radians
        message = f"{where} is given in {given!r}, which is not convertible to {fmu_unit}. Give it in {fmu_unit}."
        raise InputError(message, "wrong-unit", where, given)
    return source.factor / target.factor


def _dimension(unit: str, definitions: Iterable[Unit], where: str) -> Dimension | None:
    """What ``unit`` is made of, by its definition or else by its name; None if neither says so."""
    base = next((definition.baseUnit for definition in definitions if definition.name == unit), None)
    # A name alone, as FMI 1.0 tools write it: only those that have one meaning are known.
    if base is None:
        return KNOWN.get(unit)
    factor, offset = float(base.factor), float(base.offset)
    if not (0.0 < factor < math.inf and math.isfinite(offset)):
        message = f"{where} has the unit {unit!r}, defined with the factor {factor:g} and the offset {offset:g}."
        raise InputError(f"{message} Give its BaseUnit a positive factor and a finite offset.", "bad-unit", where, unit)
    powers, by_name = [float(getattr(base, name)) for name in EXPONENTS], KNOWN.get(unit)
    if not all(power.is_integer() for power in powers):
        message = f"{where} has the unit {unit!r}, defined with an exponent that is not a whole number."
        raise InputError(f"{message} Give its BaseUnit whole exponents.", "bad-unit", where, unit)
    exponents = tuple(map(int, powers))
    alike = by_name is not None and exponents in (by_name.exponents, KNOWN["1"].exponents)
    if by_name is not None and alike and factor == 1.0 != by_name.factor:
        # Some exporters leave the factor out, which makes a degree a radian.
        message = f"{where} has the unit {unit!r}, defined without the factor {by_name.factor:g} of its name."
        raise InputError(f"{message} Give its BaseUnit that factor, or the unit another name.", "bad-unit", where, unit)
    return Dimension(factor, exponents, offset)
