"""An FMU's variables by the names that a user gives, and their values: from what a user gives to what the type takes.

A user gives a number, a Boolean or a text, the latter also where the type of the variable is not known: on a command
line or in a file. What comes out is the only form of this value, so that equal uses of a controller are recorded alike.
"""

from __future__ import annotations

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from fmpy.model_description import ModelDescription

from ..codec import Scalar
from ..errors import InputError, unknown
from .variables import INTEGERS, REAL_TYPES, Variable, repeated_names, variables

_MISSING: Any = object()
"""An element of an array that has no value yet."""


def find_values(
    description: ModelDescription, given: Mapping[str, Scalar], what: str, driven: Collection[Variable] = ()
) -> dict[Variable, list[Scalar]]:
    """Values of parameters and inputs given by name, scalars or single elements ``K_p[1]`` of arrays, as their types
    take them. Elements of an array that are not given keep their start values.

    Raises :class:`InputError` with the nearest names if a name is unknown or cannot be set, also for an input that is
    ``driven``, which would not keep the value; and as :func:`.typed` and :func:`.check_limits`.
    """
    values: dict[Variable, list[Scalar]] = {}
    for name, value in given.items():
        variable, element = place(description, name, what)
        # The loop overwrites it in the first sample: the user would take the score for one with the value.
        if variable in driven:
            message = f"{what}: {name} cannot be set: it is an input that the benchmark drives."
            settable = [other.name for other in variables(description).values() if other.can_be_set]
            raise unknown(message, "not-settable", what, name, [other for other in settable if other != name])
        elements = values.setdefault(variable, list(variable.start) or [_MISSING] * variable.size)
        elements[element] = typed(variable, value, what)
        check_limits(variable, elements[element], what)
    for variable, elements in values.items():
        # FMI has no default for an array without start values. Zeros would be a
        # choice of ours, and the result would be named after the given ones.
        if _MISSING in elements:
            name = f"{variable.name}[{elements.index(_MISSING) + 1}]"
            message = f"{what}: {name} has neither a value nor a start value. Give all elements of {variable.name}."
            raise InputError(message, "array-parameter", what, name)
    return values


def canonical_values(description: ModelDescription, given: Mapping[str, Scalar], what: str) -> dict[str, Scalar]:
    """The same by the names that were given: the one form of these values that is recorded and told apart."""
    return {name: typed(place(description, name, what)[0], value, what) for name, value in given.items()}


def place(description: ModelDescription, name: str, what: str) -> tuple[Variable, int]:
    """The variable that can be set by ``name``, and the number of the element that it stands for, from 0."""
    by_name = variables(description)
    base, _, index = name.rstrip("]").partition("[")
    # As for connectors: to set one of two variables of a name would be a guess.
    if twofold := {name, base} & repeated_names(description):
        message = f"{what} has more than one variable {min(twofold)}, so none of them is set."
        raise InputError(f"{message} Export the FMU again.", "not-settable", what, name)
    variable = by_name.get(name)
    if variable is not None and variable.can_be_set and variable.size == 1:
        return variable, 0
    array = by_name.get(base)
    if array is not None and array.can_be_set and index.isdecimal() and 1 <= int(index) <= array.size:
        return array, int(index) - 1
    if variable is not None and variable.can_be_set:
        size = variable.size
        message = f"{what}: {name} has {size} elements: give {name}[1] and so on."
        raise InputError(message, "array-parameter", what, name, (f"{name}[{i}]" for i in range(1, size + 1)))
    settable = [name for name, one in by_name.items() if one.can_be_set]
    if variable is not None:
        message = (
            f"{what}: {name} is declared as {variable.type} {variable.causality} and cannot be set: only parameters "
        )
        raise unknown(f"{message}and inputs can.", "not-settable", what, name, settable)
    raise unknown(f"{what} has no parameter or input {name}.", "no-parameter", what, name, settable)


def elements(
    values: Mapping[str, Scalar | Sequence[Scalar]], description: ModelDescription | None = None, where: str = ""
) -> dict[str, Scalar]:
    """``values`` with those of an array by element: ``K_p = [45, 15]`` gives ``K_p[1]`` and ``K_p[2]``.

    Raises :class:`InputError` for an element that is given twice, of which one value was lost, for an empty list, and
    for one that is shorter than the array in the ``description``, if that is known.
    """
    listed: dict[str, Scalar] = {}
    begin = f"{where or 'The parameters'}: "
    for name, value in values.items():
        single = isinstance(value, bool | int | float | str)
        given = {name: value} if single else {f"{name}[{i}]": element for i, element in enumerate(value, start=1)}  # type: ignore[arg-type]
        if not given:
            raise InputError(f"{begin}the list of values of {name} is empty.", "bad-parameters", where, name)
        for element in given:
            if element in listed:
                raise InputError(f"{begin}{element} is given more than once.", "repeated", where, element)
        size = 0 if single or description is None else _size(description, name)
        if len(given) < size:
            message = f"{begin}{name} has {size} elements, and {len(given)} are given. Give all, or those to be changed"
            raise InputError(f"{message} by their names, such as {name}[1].", "array-parameter", where, name)
        listed.update(given)  # type: ignore[arg-type]  # a scalar, or elements of a list
    return listed


def _size(description: ModelDescription, name: str) -> int:
    """The number of elements that ``name`` has, as an array or as scalars ``name[1]``, ``name[2]``, ..."""
    declared = variables(description)
    if name in declared:
        return declared[name].size
    size = 0
    while f"{name}[{size + 1}]" in declared:
        size += 1
    return size


def find_outputs(description: ModelDescription, names: Iterable[str], what: str) -> list[Variable]:
    """The scalar real outputs called ``names``; raises :class:`InputError` with the nearest if one is unknown."""
    outputs = {
        name: v for name, v in variables(description).items() if v.is_real and v.size == 1 and v.causality == "output"
    }
    for name in names:
        if name not in outputs:
            raise unknown(f"{what} has no output {name}.", "no-output", what, name, outputs)
    return [outputs[name] for name in names]


MAX_FLOAT32 = 3.4028234663852886e38
"""Largest number of type Float32."""

BOOLEANS = {"true": True, "false": False, "1": True, "0": False}

NUMBER = re.compile(r"[+-]?(?:(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|inf|infinity|nan)", re.IGNORECASE)
"""A number as a text: float() takes 1_0 for ten, and the digits of all scripts."""

WHOLE = re.compile(r"[+-]?[0-9]+")


def typed(variable: Variable, given: Scalar, what: str) -> Scalar:
    """``given`` as a value of ``variable``: a float for a real type, an int for an integer type and for an enumeration,
    a bool, a text; of a Binary the hexadecimal digits.

    ``what`` ("The controller x.fmu") begins messages. Raises :class:`InputError` for a value of another type, or one
    that is outside the type's range or an enumeration.
    """
    if variable.type in REAL_TYPES:
        return _real(variable, given, what)
    if variable.type == "Enumeration":
        return _item(variable, given, what)
    if variable.type in INTEGERS:
        return _integer(variable, given, what)
    if variable.type == "Boolean":
        return _boolean(variable, given, what)
    return _text(variable, given, what)


def check_limits(variable: Variable, value: Scalar, what: str) -> None:
    """Raise :class:`InputError` if ``value`` is outside the limits that the FMU declares for ``variable``.

    That is looked at where a simulation begins, not where a controller is described: a tuning may try values that the
    FMU does not take.
    """
    low, high = variable.limits
    if isinstance(value, int | float) and not low <= value <= high:
        message = f"{what}: {variable.name} = {value!r} is not from {low:g} to {high:g}, as the FMU declares it."
        raise InputError(message, "bad-value", what, variable.name)


def _real(variable: Variable, given: Scalar, what: str) -> float:
    try:
        if isinstance(given, bool):
            raise ValueError
        value = number(given)
    except (ValueError, OverflowError):
        raise _wrong(variable, given, what, "not a number", "not-a-number") from None
    # What ctypes makes of a larger one is infinity, without an error.
    largest = MAX_FLOAT32 if variable.type == "Float32" else math.inf
    if not math.isfinite(value) or abs(value) > largest:
        raise _wrong(variable, given, what, "not a finite number", "not-finite")
    return value


def number(given: float | str) -> float:
    """``given`` as a float; raises :class:`ValueError` or :class:`OverflowError`."""
    if isinstance(given, str) and not NUMBER.fullmatch(given.strip()):
        raise ValueError(f"{given!r} is not a number")
    return float(given)


def _whole(given: Scalar) -> int | None:
    """A whole number; None if it is none."""
    if isinstance(given, str):
        # int() takes "1_000" and digits of all scripts, and more than 4,300 digits raise an error of its own.
        return int(given) if WHOLE.fullmatch(given.strip()) and len(given) < 30 else None
    # int(inf) raises an OverflowError; True is no count.
    if isinstance(given, bool) or not math.isfinite(given) or given != int(given):
        return None
    return int(given)


def _integer(variable: Variable, given: Scalar, what: str) -> int:
    value = _whole(given)
    low, high = INTEGERS[variable.type]
    if value is None:
        raise _wrong(variable, given, what, "not a whole number")
    if not low <= value <= high:
        raise _wrong(variable, given, what, f"not from {low} to {high}")
    return value


def _item(variable: Variable, given: Scalar, what: str) -> int:
    """The number of an item. A whole number is one, also as a text; any other text is a name."""
    value, names = _whole(given), [name for _, name in variable.items]
    if value is None and isinstance(given, str):
        value = next((number for number, name in variable.items if name == given.strip()), None)
    low, high = INTEGERS[variable.type]
    if value is None or (variable.items and value not in dict(variable.items)) or not low <= value <= high:
        message = f"{what}: {variable.name} has no item {given}."
        raise unknown(message, "bad-value", what, str(given), names)
    return value


def _boolean(variable: Variable, given: Scalar, what: str) -> bool:
    value = BOOLEANS.get(given.strip().lower()) if isinstance(given, str) else bool(given) if given in (0, 1) else None
    if value is None:
        raise _wrong(variable, given, what, "neither true nor false")
    return value


def _text(variable: Variable, given: Scalar, what: str) -> str:
    if not isinstance(given, str):
        raise _wrong(variable, given, what, "not a text")
    if variable.type == "Binary":
        try:
            return bytes.fromhex(given).hex()
        except ValueError:
            raise _wrong(variable, given, what, "not a pair of hexadecimal digits for each byte") from None
    # C ends the text there, so the FMU would get another one than the results tell.
    if "\0" in given:
        raise _wrong(variable, given, what, "a text that ends before its end")
    return given


def _wrong(variable: Variable, given: Scalar, what: str, why: str, code: str = "bad-value") -> InputError:
    message = f"{what}: the value of {variable.name}, {given!r}, is {why}; its type is {variable.type}."
    return InputError(message, code, what, given)
