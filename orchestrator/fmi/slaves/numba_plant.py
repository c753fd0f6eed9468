"""The manipulator in Python as machine code: see :mod:`.numba_slave`."""

from __future__ import annotations

from typing import Any

from numba import carray

from plant_fmu.flexible_manipulator.integrator import STATE, STATE_SIZE, advance

from .machine_code import OK, as_step, read, write

__all__ = ["memory", "read", "step", "write"]

SIZE = STATE + STATE_SIZE


def memory(state: dict[str, Any]) -> list[float]:
    """The memory from the FMU's serialized state."""
    values: list[float] = state["memory"]
    return values


@as_step
def step(memory, _time, step, _flag):  # type: ignore[no-untyped-def]
    """The FMU's doStep."""
    advance(carray(memory, SIZE), step)  # type: ignore[no-untyped-call]
    return OK
