"""What callers give to public functions, as plain values of Python: one rule for every parameter, by its annotation.

NumPy's scalars look like numbers and are none to JSON, MessagePack and ``isinstance``: they are made plain where they
come in, and not where they would first do harm. A parameter whose annotation is not listed here fails when its function
is defined.
"""

from __future__ import annotations

import functools
import inspect
import math
import os
from collections.abc import Callable, Iterable, Mapping, Set
from dataclasses import fields
from decimal import Decimal
from fractions import Fraction
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from .errors import InputError
from .exact_time import seconds

F = TypeVar("F", bound=Callable[..., Any])

NUMPY = "biufU"
"""Kinds of NumPy's types that stand for values of Python's: not objects, dates and complex numbers."""

NUMBERS = (float, int, Fraction, Decimal)

Enter = Callable[[str, Any], Any]
"""``enter(name, value)`` gives the plain value of a parameter of this name; raises :class:`InputError`."""


def plain(value: Any) -> Any:
    """``value`` with NumPy's scalars as Python's own and its arrays as lists, also in a mapping, list or tuple."""
    if isinstance(value, np.ndarray | np.generic) and value.dtype.kind in NUMPY:
        return (value.astype(np.float64) if value.dtype.kind == "f" else value).tolist()  # those of more bits, too
    if isinstance(value, Mapping):
        return {plain(key): plain(item) for key, item in value.items()}
    if type(value) in (list, tuple):
        return type(value)(map(plain, value))
    return value


def real(name: str, value: Any) -> float:
    """A number, which may be infinite, as a limit that there is not; but not NaN."""
    number = plain(value)
    if isinstance(number, bool) or not isinstance(number, NUMBERS):  # a switch that was mistaken for a probability
        raise _refusal(name, "a number", value)
    try:
        found = float(number)
    except (OverflowError, ValueError):
        raise _refusal(name, "a number", value) from None
    if math.isnan(found):
        raise _refusal(name, "a number", value)
    return found


def finite(name: str, value: Any) -> float:
    """A finite number."""
    found = real(name, value)
    if math.isinf(found):
        raise _refusal(name, "a finite number", value)
    return found


def whole(name: str, value: Any) -> int:
    """A whole number."""
    number = plain(value)
    if isinstance(number, bool) or not isinstance(number, NUMBERS) or not _is_whole(number):
        raise _refusal(name, "a whole number", value)
    return int(number)


def _is_whole(number: Any) -> bool:
    return math.isfinite(number) and number == int(number)


def switch(name: str, value: Any) -> bool:
    """True or False."""
    found = plain(value)
    if not isinstance(found, int) or found not in (True, False):
        raise _refusal(name, "True or False", value)
    return bool(found)


def pair(name: str, value: Any) -> tuple[float, float]:
    """Two finite numbers."""
    first, second = _two(name, value, "two finite numbers")
    return finite(name, first), finite(name, second)


def time(name: str, value: Any) -> Fraction:
    """A time [s]; a float counts as the decimal number that it prints as."""
    if isinstance(value, np.ndarray) and value.ndim == 0:
        value = value[()]
    # As text, since the number that a float of single precision prints as is another one than that of its value.
    exact = str(value) if isinstance(value, np.floating | Decimal) else plain(value)
    try:
        return seconds(exact)
    except ValueError:
        raise _refusal(name, "a time in seconds", value, "bad-time") from None


def times(name: str, value: Any) -> tuple[Fraction, Fraction]:
    """Two times [s]."""
    first, second = _two(name, value, "two times in seconds")
    return time(name, first), time(name, second)


def _two(name: str, value: Any, what: str) -> tuple[Any, Any]:
    """The two elements of a sequence or an array, as they are: not of a set, which has no order, nor the names of a
    mapping, nor the digits of a text."""
    if isinstance(value, str | bytes | Mapping | Set):
        raise _refusal(name, what, value)
    try:
        first, second = value
    except (TypeError, ValueError):
        raise _refusal(name, what, value) from None
    return first, second


def text(name: str, value: Any) -> str:
    """A text."""
    found = plain(value)
    if not isinstance(found, str):
        raise _refusal(name, "a text", value, "bad-text")
    return found


def path(name: str, value: Any) -> str | Path:
    """A path, or a name that may be one."""
    found = plain(value)
    if isinstance(found, str | Path):
        return found
    if isinstance(found, os.PathLike) and isinstance(found.__fspath__(), str):
        return Path(found)
    raise _refusal(name, "a path", value, "bad-path")


def texts(name: str, value: Any) -> str | tuple[str, ...]:
    """Texts, or one."""
    found = plain(value)
    return found if isinstance(found, str) else _sequence(text)(name, value)


def _sequence(enter: Enter) -> Callable[[str, Any], tuple[Any, ...]]:
    """The rule for a sequence whose elements have the rule ``enter``."""

    def each(name: str, value: Any) -> tuple[Any, ...]:
        if isinstance(value, str | bytes | Mapping) or not _is_iterable(value):
            raise _refusal(name, "a sequence", value)
        return tuple(enter(name, item) for item in value)

    return each


def _is_iterable(value: Any) -> bool:
    return value.ndim > 0 if isinstance(value, np.ndarray) else isinstance(value, Iterable)


def _mapping(enter: Enter) -> Callable[[str, Any], dict[str, Any]]:
    """The rule for a mapping by name whose values have the rule ``enter``."""

    def each(name: str, value: Any) -> dict[str, Any]:
        if not isinstance(value, Mapping):
            raise _refusal(name, "a mapping by name", value, "bad-mapping")
        return {text(name, key): enter(f"{name}[{key!r}]", item) for key, item in value.items()}

    return each


def _ranges(name: str, value: Any) -> Any:
    """A range as such, or its two ends and perhaps its scale."""
    found = plain(value)
    if not isinstance(found, list | tuple):
        return found
    if len(found) < 2:
        raise _refusal(name, "a range of two numbers", value, "bad-range")
    return finite(name, found[0]), finite(name, found[1]), *found[2:]


def _value(name: str, value: Any) -> Any:
    """A value for a variable of an FMU: a number, a text, True or False, or several."""
    found = plain(value)
    if isinstance(found, Fraction | Decimal):
        return float(found)
    if isinstance(found, list | tuple):
        if any(isinstance(item, list | tuple) for item in found):  # a matrix was flattened, or a traceback
            raise _refusal(name, "a value or a list of values, without lists in it", value)
        return [_value(name, item) for item in found]
    if not isinstance(found, bool | int | float | str):
        raise _refusal(name, "a value for a variable", value)
    return found


def _or_file(enter: Enter) -> Enter:
    return lambda name, value: enter(name, value) if isinstance(value, Mapping) else path(name, value)


def _file_or_other(name: str, value: Any) -> Any:
    """A path as such; anything else, of which the function has types of its own, as it is."""
    found = plain(value)
    return path(name, found) if isinstance(found, str | os.PathLike) else value


def _object(kind: str) -> Enter:
    """The rule for one of the :data:`OBJECTS`. Their types lie above this room: they are known by name."""
    own = kind.partition("[")[0]

    def check(name: str, value: Any) -> Any:
        if own.startswith("On"):
            if not callable(value):
                raise _refusal(name, "a function", value, "bad-object")
        elif own != "Any" and own not in (each.__name__ for each in type(value).__mro__):
            article = "an" if own[0] in "AEIO" else "a"
            raise _refusal(name, f"{article} {own}", value, "bad-object")
        return value

    return check


def _or_text(kind: str) -> Enter:
    return lambda name, value: text(name, value) if isinstance(plain(value), str) else _object(kind)(name, value)


def results(name: str, value: Any) -> tuple[Any, ...]:
    """Results that can be compared."""
    return _sequence(_object("Comparable"))(name, value)


RULES: dict[str, Enter] = {
    "bool": switch,
    "int": whole,
    "float": real,
    "str": text,
    "str | Path": path,
    "Pair": pair,
    "Delays": times,
    "Fraction": time,
    "Fraction | float | str": time,
    "tuple[float, float]": pair,
    "Iterable[int]": _sequence(whole),
    "Sequence[str]": _sequence(text),
    "Sequence[str] | str": texts,
    "Mapping[str, float]": _mapping(finite),
    "Mapping[str, float] | str | Path": _or_file(_mapping(_value)),
    "Mapping[str, Scalar]": _mapping(_value),
    "Mapping[str, Scalar | Sequence[Scalar]] | str | Path": _or_file(_mapping(_value)),
    "Mapping[str, str] | str | Path": _or_file(_mapping(text)),
    "Mapping[str, Sequence[float]]": _mapping(_sequence(finite)),
    "Mapping[str, Range | tuple[float, float] | tuple[float, float, str]]": _mapping(_ranges),
    "Given": _file_or_other,
    "Given | object": _file_or_other,
    "Case | str": _or_text("Case"),
    "Distribution": text,
    "Friction": text,
    "Order": text,
    "Way": text,
    "Sequence[Fraction | float | str]": _sequence(time),
}
"""By annotation, without ``None``."""

OBJECTS = {
    "Any",
    "Case",
    "Controller",
    "Entropy",
    "EvaluationStudy",
    "OnEvent",
    "OnProgress",
    "OnResult",
    "OnSeed",
    "OnTrial",
    "Study[Any]",
    "Study[T]",
    "Variation",
    "Verification",
}
"""Annotations of parameters that only the package's own types, or functions, can be given for."""


def rule(annotation: str) -> Enter:
    """The rule of an annotation; a :class:`TypeError` if there is none."""
    kind = annotation.removesuffix(" | None")
    if kind in OBJECTS:
        found = _object(kind)
        return found if kind == annotation else functools.partial(_optional, found)
    if kind not in RULES:
        raise TypeError(f"there is no rule for parameters of the type {annotation}")
    return RULES[kind] if kind == annotation else functools.partial(_optional, RULES[kind])


def _optional(enter: Enter, name: str, value: Any) -> Any:
    return None if value is None else enter(name, value)


def border(function: Callable[..., Any]) -> Callable[..., inspect.BoundArguments]:
    """What makes the arguments of ``function`` plain, and binds them to its parameters."""
    signature = inspect.signature(function)
    rules = {name: rule(each.annotation) for name, each in signature.parameters.items() if name not in ("self", "cls")}

    def bound(*arguments: Any, **named: Any) -> inspect.BoundArguments:
        found = signature.bind(*arguments, **named)
        for name, value in found.arguments.items():
            if name in rules:
                found.arguments[name] = rules[name](name, value)
        return found

    return bound


def entered(function: F) -> F:
    """``function`` with its arguments made plain."""
    bound = border(function)

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        found = bound(*arguments, **named)
        return function(*found.args, **found.kwargs)

    return call  # type: ignore[return-value]  # of the same signature


def enter_fields(instance: Any) -> None:
    """Make the fields of a frozen dataclass plain, before it looks at them."""
    for field in fields(instance):
        object.__setattr__(instance, field.name, rule(str(field.type))(field.name, getattr(instance, field.name)))


def _refusal(name: str, what: str, value: Any, code: str = "bad-number") -> InputError:
    shown = repr(value)
    words = shown if len(shown) <= 60 else f"a value of the type {type(value).__name__}"
    return InputError(f"{name} must be {what}, not {words}.", code, name, value)
