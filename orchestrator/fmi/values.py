"""Values of an FMU's parameters and inputs: from what a user gives to what the type of the variable takes.

A user gives a number, a Boolean or a text, the latter also where the type of the variable is not known: on a command
line or in a file. What comes out is the only form of this value, so that equal uses of a controller are recorded alike.
"""

from __future__ import annotations

import math
import re

from ..codec import Scalar
from ..errors import InputError, unknown
from .variables import INTEGERS, REAL_TYPES, Variable

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
