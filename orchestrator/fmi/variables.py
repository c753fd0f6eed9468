"""The real variables of an FMU, of any FMI version, in one form."""

from __future__ import annotations

import functools
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from fmpy.model_description import ModelDescription, ModelVariable

from ..errors import InputError

REAL_TYPES = ("Real", "Float64", "Float32")


@dataclass(frozen=True)
class Variable:
    """A scalar (size 1) or an array of an FMU; ``unit`` is the declared name, None if there is none.

    ``start`` holds the declared start values, one per element, or nothing.
    """

    name: str
    reference: int
    type: str
    size: int
    causality: str
    variability: str
    unit: str | None
    start: tuple[float, ...]

    @property
    def is_real(self) -> bool:
        """Whether the master can set and get it."""
        return self.type in REAL_TYPES


@functools.lru_cache(maxsize=16)
def variables(description: ModelDescription) -> dict[str, Variable]:
    """All variables of an FMU by name; raises :class:`InputError` if a real's start value is not numeric."""
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
    return Variable(
        name=variable.name,
        reference=int(variable.valueReference),
        type=variable.type,
        size=size,
        causality=variable.causality or "local",
        variability=variable.variability or "",
        unit=unit or None,
        start=_numbers(variable.name, variable.start, size) if variable.type in REAL_TYPES else (),
    )


def _numbers(name: str, start: Any, size: int) -> tuple[float, ...]:
    if start is None:
        return ()
    words = start.split() if isinstance(start, str) else start if isinstance(start, Sequence) else [start]
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) not in (1, size):
        message = f"The start value of {name}, {start!r}, is not one number per element. Export the FMU again."
        raise InputError(message, "bad-start", name, start)
    return numbers * size if len(numbers) == 1 else numbers
