"""The variables of an FMU, of any FMI version, in one form."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Sequence
from typing import Any

import msgspec
from fmpy.model_description import ModelDescription, ModelVariable

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
    elements = sum(math.prod(variable.shape) for variable in description.modelVariables if variable.shape)
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
