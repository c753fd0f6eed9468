"""The disturbances and imperfections of the loop, one small function each. Compiled, and callable from Python."""

from __future__ import annotations

import numpy as np

import plant_fmu.flexible_manipulator.elementary  # noqa: F401  (lets the chirp be compiled)

from ..jit import compiled
from . import disturbances

chirp, pulse = compiled(disturbances.chirp), compiled(disturbances.pulse)


@compiled
def saturate(value: float, limit: float) -> float:
    """``value`` limited to +-``limit``."""
    return min(max(value, -limit), limit)


@compiled
def quantize(value: float, quantum: float) -> float:
    """``value`` rounded to the nearest multiple of ``quantum``; unchanged if the quantum is 0."""
    if quantum > 0.0:
        # Halves go to even: that is rint of C as well, so recheck and the
        # twin in C (imperfections/model.c) get the same level.
        rounded: float = np.rint(value / quantum) * quantum
        return rounded
    return value


@compiled
def amplify(value: float, centre: float, gain: float) -> float:
    """Loop gain about a working point, ``centre + gain (value - centre)``; at gain 1 exactly ``value``."""
    # centre + (value - centre) is not value, to the last bit.
    if gain == 1.0:
        return value
    return centre + gain * (value - centre)
