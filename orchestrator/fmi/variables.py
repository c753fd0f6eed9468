"""The variables of an FMU, of any FMI version, in one form.

And their units: the factor from an FMU's declared unit to a connector's, from a given one to the FMU's, by base units.
"""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import msgspec
from fmpy.model_description import ModelDescription, ModelVariable, Unit

from ..codec import Scalar
from ..errors import InputError

REAL_TYPES = ("Real", "Float64", "Float32")

INTEGERS = {
    "Integer": (-(2**31), 2**31 - 1),
    "Enumeration": (-(2**31), 2**31 - 1),
    **{f"Int{bits}": (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1) for bits in (8, 16, 32, 64)},
    **{f"UInt{bits}": (0, 2**bits - 1) for bits in (8, 16, 32, 64)},
}
"""Smallest and largest value by type. FMI 1.0 and 2.0 have Integer, FMI 3.0 the types with a size."""

SET_TYPES = (*REAL_TYPES, *INTEGERS, "Boolean", "String", "Binary")
"""Types of variables that can be set."""

MAX_ELEMENTS = 1_000_000
"""Elements of all arrays of an FMU together."""

GIVEN = ("parameter", "input")
"""Causalities of variables that can be set."""


class Variable(msgspec.Struct, frozen=True):
    """A scalar (size 1) or an array of an FMU; ``unit`` is the declared name, None if there is none.

    ``start`` holds the declared start values, one per element, or nothing; of a Binary, hexadecimal digits. ``items``
    are the numbers and names of an enumeration, ``limits`` the declared smallest and largest value, infinite if there
    is none.
    """

    name: str
    reference: int
    type: str
    size: int
    causality: str
    variability: str
    unit: str | None
    start: tuple[Scalar, ...]
    items: tuple[tuple[int, str], ...] = ()
    limits: tuple[float, float] = (-math.inf, math.inf)

    @property
    def is_real(self) -> bool:
        """Whether it can be a connector."""
        return self.type in REAL_TYPES

    @property
    def can_be_set(self) -> bool:
        """Whether a user may give it a value."""
        return self.causality in GIVEN and self.type in SET_TYPES

    @property
    def numbers(self) -> tuple[float, ...]:
        """The start values of a real type."""
        return tuple(value for value in self.start if isinstance(value, float))

    def spelled(self, value: Scalar) -> str:
        """A value for people: Booleans as in FMI, the number of an item with its name."""
        if isinstance(value, bool):
            return "true" if value else "false"
        if isinstance(value, str):
            return repr(value)
        item = dict(self.items).get(int(value)) if self.items else None
        return f"{value:g}" if isinstance(value, float) else f"{value}" + (f" ({item})" if item else "")


@functools.lru_cache(maxsize=16)
def variables(description: ModelDescription) -> dict[str, Variable]:
    """All variables of an FMU by name; raises :class:`InputError` if a real's start value is not numeric."""
    shapes = [variable.shape for variable in description.modelVariables if variable.shape]
    # It would be taken off the sum: beside an array of -5e8 elements, one of 5e8 took 4 GB in the process of a check.
    if any(size < 0 for shape in shapes for size in shape):
        message = f"An array of {description.modelName} has a negative size. Export the FMU again."
        raise InputError(message, "bad-description", description.modelName)
    elements = sum(map(math.prod, shapes))
    if elements > MAX_ELEMENTS:  # a kilobyte of XML can declare more than any memory holds
        message = f"The arrays of {description.modelName} have {elements} elements, more than {MAX_ELEMENTS}."
        raise InputError(f"{message} Export it with smaller ones.", "bad-description", description.modelName)
    return {variable.name: _convert(variable) for variable in description.modelVariables}


@functools.lru_cache(maxsize=16)
def repeated_names(description: ModelDescription) -> frozenset[str]:
    """Names that more than one variable has; :func:`variables` gives the last of them."""
    count = Counter(variable.name for variable in description.modelVariables)
    return frozenset(name for name, number in count.items() if number > 1)


def _convert(variable: ModelVariable) -> Variable:
    declared = variable.declaredType
    unit = variable.unit or (declared.unit if declared is not None else None)
    size = math.prod(variable.shape) if variable.shape else 1
    real, causality = variable.type in REAL_TYPES, variable.causality or "local"
    details: dict[str, Any] = {}
    if causality in GIVEN:  # the others are many, and nobody asks for these
        items = declared.items if declared is not None else []
        details = {
            "items": tuple((int(item.value), str(item.name)) for item in items if _is_whole(item.value)),
            "limits": (_limit(variable, "min", -math.inf), _limit(variable, "max", math.inf)),
        }
    start = (
        _numbers(variable.name, variable.start, size)
        if real
        else _other_start(variable.type, variable.start, size)
        if details
        else ()
    )
    return Variable(
        name=variable.name,
        reference=_reference(variable),
        type=variable.type,
        size=size,
        causality=causality,
        variability=variable.variability or "",
        unit=unit or None,
        start=start,
        **details,
    )


def _reference(variable: ModelVariable) -> int:
    """The value reference, which calls pass as 32 bits without a sign."""
    # FMPy passes on what the file says; beyond 32 bits, NumPy would raise an OverflowError in the middle of a run.
    text = str(variable.valueReference)
    if not _is_whole(text) or not 0 <= int(text) < 2**32:
        message = f"The value reference of {variable.name}, {text!r}, is no whole number from 0 to 4294967295."
        raise InputError(f"{message} Export the FMU again.", "bad-description", variable.name, text)
    return int(text)


def _numbers(name: str, start: Any, size: int) -> tuple[float, ...]:
    if start is None:
        return ()
    words = start.split() if isinstance(start, str) else start if isinstance(start, Sequence) else [start]
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    # FMI 3.0 lets an array have one start value for all of its elements.
    if len(numbers) not in (1, size):
        message = f"The start value of {name}, {start!r}, is not one number per element. Export the FMU again."
        raise InputError(message, "bad-start", name, start)
    return numbers * size if len(numbers) == 1 else numbers


def _other_start(kind: str, start: Any, size: int) -> tuple[Scalar, ...]:
    """Start values of a type that is not real; nothing where they cannot be read, as nothing depends on them."""
    if start is None or kind not in SET_TYPES:
        return ()
    words = [str(start)] if kind in ("String", "Binary") else str(start).split()
    if kind == "Boolean" and set(words) <= {"true", "false", "1", "0"}:
        values: tuple[Scalar, ...] = tuple(word in ("true", "1") for word in words)
    elif kind in INTEGERS and all(map(_is_whole, words)):
        values = tuple(map(int, words))
    else:
        values = tuple(words) if kind in ("String", "Binary") else ()
    return (
        values * size if len(values) == 1 and kind in (*INTEGERS, "Boolean") else values if len(values) == size else ()
    )


def _is_whole(word: Any) -> bool:
    text = str(word)
    return text.isascii() and text.removeprefix("-").isdigit() and len(text) < 30


def _limit(variable: ModelVariable, key: str, default: float) -> float:
    """The declared limit, of the variable or else of its type."""
    declared = getattr(variable, key) or (getattr(variable.declaredType, key, None) if variable.declaredType else None)
    try:
        value = float(declared) if declared is not None else default
    except ValueError:
        return default
    # An Int64 beyond 2**53 is no float; as an int the limit stays exact.
    return default if math.isnan(value) else int(str(declared)) if _is_whole(declared) else value


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
