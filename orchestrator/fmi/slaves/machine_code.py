"""C functions by Numba with the signatures of FMI 2.0, on a memory in which a variable's index is its reference."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from numba import cfunc, types

NUMBERS, REFERENCES = types.CPointer(types.float64), types.CPointer(types.uint32)
ACCESS = types.int32(NUMBERS, REFERENCES, types.uint64, NUMBERS)
STEP = types.int32(NUMBERS, types.float64, types.float64, types.int32)
OK, ERROR = 0, 3

OPTIONS: dict[str, Any] = {"cache": True, "fastmath": False, "error_model": "numpy"}
"""As those of :mod:`orchestrator.jit`, but for Numba's runtime, without which no C function takes an array."""

as_step: Callable[[Any], Any] = cfunc(STEP, **OPTIONS)
"""A function (memory, time, step, flag) as fmi2DoStep."""


@cfunc(ACCESS, **OPTIONS)
def write(memory, references, count, values):  # type: ignore[no-untyped-def]
    """fmi2SetReal."""
    for i in range(count):
        memory[references[i]] = values[i]
    return OK


@cfunc(ACCESS, **OPTIONS)
def read(memory, references, count, values):  # type: ignore[no-untyped-def]
    """fmi2GetReal."""
    for i in range(count):
        values[i] = memory[references[i]]
    return OK
