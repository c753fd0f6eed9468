"""The paper's PID in Python as machine code: see :mod:`.numba_slave`."""

from __future__ import annotations

from typing import Any

from controller_fmu.pid.diagonal_pid_fmu import (
    K_D,
    K_I,
    K_P,
    Q_M,
    Q_M_REF,
    T_S,
    U_M,
    VARIABLES,
    Z_P,
    Gains,
    sample,
    torque,
)

from ...jit import compiled
from .machine_code import ERROR, OK, as_step, read, write

__all__ = ["memory", "read", "step", "write"]

STEP_TOLERANCE = 1e-9
"""Of the sample time. The loop's own steps are exact: what the FMU forgives other masters does not occur."""

STATE = sum(len(start) for _, _, start, _ in VARIABLES)
"""Where in the memory the states of the axes begin: behind the FMU's variables."""

next_state, output = compiled(sample), compiled(torque)


def memory(state: dict[str, Any]) -> list[float]:
    """The memory from the FMU's serialized state."""
    return [*state["values"], *(number for axis in state["states"] for number in axis)]


@as_step
def step(memory, _time, step, _flag):  # type: ignore[no-untyped-def]
    """The FMU's doStep."""
    if not abs(step - memory[T_S]) <= STEP_TOLERANCE * memory[T_S]:
        return ERROR
    for i in range(2):
        gains = Gains(memory[K_P + i], memory[K_I + i], memory[K_D + i], memory[Z_P + i], memory[T_S])
        at = STATE + 3 * i
        before = (memory[at], memory[at + 1], memory[at + 2])
        now = next_state(gains, before, memory[Q_M_REF + i] - memory[Q_M + i])
        memory[at], memory[at + 1], memory[at + 2] = now
        memory[U_M + i] = output(gains, now)
    return OK
