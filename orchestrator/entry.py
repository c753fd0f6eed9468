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
    # Not isinstance: a named tuple is one of the package's own types, and stays what it is.
    if type(value) in (list, tuple):
        return type(value)(map(plain, value))
    return value


def real(name: str, value: Any) -> float:
    """A number, which may be infinite, as a limit that there is not; but not NaN."""
    number = plain(value)
    if isinstance(number, bool) or not isinstance(number, NUMBERS):  # a switch that was mistaken for a probability
        raise _refusal(name, "a number", value)
    try:
        converted = float(number)
    except (OverflowError, ValueError):
        raise _refusal(name, "a number", value) from None
    if math.isnan(converted):
        raise _refusal(name, "a number", value)
    return converted


def finite(name: str, value: Any) -> float:
    """A finite number."""
    number = real(name, value)
    if math.isinf(number):
        raise _refusal(name, "a finite number", value)
    return number


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
    plain_value = plain(value)
    if not isinstance(plain_value, int) or plain_value not in (True, False):
        raise _refusal(name, "True or False", value)
    return bool(plain_value)


def pair(name: str, value: Any) -> tuple[float, float]:
    """Two finite numbers."""
    first, second = _two(name, value, "two finite numbers")
    return finite(name, first), finite(name, second)


def limits(name: str, value: Any) -> tuple[float, float]:
    """Two limits; an infinite one is none."""
    first, second = _two(name, value, "two numbers")
    return real(name, first), real(name, second)


def time(name: str, value: Any) -> Fraction:
    """A time [s]; a float counts as the decimal number that it prints as."""
    # An array without a dimension is no np.floating; [()] takes its number out.
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
    plain_value = plain(value)
    if not isinstance(plain_value, str):
        raise _refusal(name, "a text", value, "bad-text")
    return plain_value


def path(name: str, value: Any) -> str | Path:
    """A path, or a name that may be one."""
    plain_value = plain(value)
    if isinstance(plain_value, str | Path):
        return plain_value
    if isinstance(plain_value, os.PathLike) and isinstance(plain_value.__fspath__(), str):
        return Path(plain_value)
    raise _refusal(name, "a path", value, "bad-path")


def texts(name: str, value: Any) -> str | tuple[str, ...]:
    """Texts, or one."""
    plain_value = plain(value)
    return plain_value if isinstance(plain_value, str) else _sequence(text)(name, value)


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
    plain_value = plain(value)
    if not isinstance(plain_value, list | tuple):
        return plain_value
    if len(plain_value) < 2:
        raise _refusal(name, "a range of two numbers", value, "bad-range")
    return finite(name, plain_value[0]), finite(name, plain_value[1]), *plain_value[2:]


def _value(name: str, value: Any) -> Any:
    """A value for a variable of an FMU: a number, a text, True or False, or several."""
    plain_value = plain(value)
    if isinstance(plain_value, Fraction | Decimal):
        return float(plain_value)
    if isinstance(plain_value, list | tuple):
        if any(isinstance(item, list | tuple) for item in plain_value):  # a matrix was flattened, or a traceback
            raise _refusal(name, "a value or a list of values, without lists in it", value)
        return [_value(name, item) for item in plain_value]
    if not isinstance(plain_value, bool | int | float | str):
        raise _refusal(name, "a value for a variable", value)
    return plain_value


def _or_file(enter: Enter) -> Enter:
    return lambda name, value: enter(name, value) if isinstance(value, Mapping) else path(name, value)


def _file_or_other(name: str, value: Any) -> Any:
    """A path as such; anything else, of which the function has types of its own, as it is."""
    plain_value = plain(value)
    return path(name, plain_value) if isinstance(plain_value, str | os.PathLike) else value


def _object(kind: str) -> Enter:
    """The rule for one of the :data:`OBJECTS`. Their types lie above this room: they are known by name."""
    type_name = kind.partition("[")[0]

    def check(name: str, value: Any) -> Any:
        if type_name.startswith("On"):
            if not callable(value):
                raise _refusal(name, "a function", value, "bad-object")
        elif type_name != "Any" and type_name not in (ancestor.__name__ for ancestor in type(value).__mro__):
            article = "an" if type_name[0] in "AEIO" else "a"
            raise _refusal(name, f"{article} {type_name}", value, "bad-object")
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
    "Limits": limits,
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
    "LibraryKind": text,
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
        check = _object(kind)
        return check if kind == annotation else functools.partial(_optional, check)
    if kind not in RULES:
        # At the definition, so that no public function is without a rule when it is called.
        raise TypeError(f"there is no rule for parameters of the type {annotation}")
    return RULES[kind] if kind == annotation else functools.partial(_optional, RULES[kind])


def _optional(enter: Enter, name: str, value: Any) -> Any:
    return None if value is None else enter(name, value)


def border(function: Callable[..., Any]) -> Callable[..., inspect.BoundArguments]:
    """What makes the arguments of ``function`` plain, and binds them to its parameters."""
    signature = inspect.signature(function)
    rules = {
        name: rule(parameter.annotation)
        for name, parameter in signature.parameters.items()
        if name not in ("self", "cls")
    }

    def bound(*arguments: Any, **named: Any) -> inspect.BoundArguments:
        bound_arguments = signature.bind(*arguments, **named)
        for name, value in bound_arguments.arguments.items():
            if name in rules:
                bound_arguments.arguments[name] = rules[name](name, value)
        return bound_arguments

    return bound


def entered(function: F) -> F:
    """``function`` with its arguments made plain."""
    bound = border(function)

    @functools.wraps(function)
    def call(*arguments: Any, **named: Any) -> Any:
        bound_arguments = bound(*arguments, **named)
        return function(*bound_arguments.args, **bound_arguments.kwargs)

    return call  # type: ignore[return-value]  # of the same signature


def enter_fields(instance: Any) -> None:
    """Make the fields of a frozen dataclass plain, before it looks at them."""
    for field in fields(instance):
        # How a frozen dataclass is changed: only here, before anybody else has it.
        object.__setattr__(instance, field.name, rule(str(field.type))(field.name, getattr(instance, field.name)))


def _refusal(name: str, what: str, value: Any, code: str = "bad-number") -> InputError:
    shown = repr(value)
    words = shown if len(shown) <= 60 else f"a value of the type {type(value).__name__}"
    return InputError(f"{name} must be {what}, not {words}.", code, name, value)
