"""The disturbances and imperfections of the loop, one small function each, and normal random numbers that have the same
bits on every platform. Compiled, and callable from Python.
"""

from __future__ import annotations

import math

import numpy as np

import plant_fmu.flexible_manipulator.elementary  # noqa: F401  (lets the chirp be compiled)
from plant_fmu.flexible_manipulator.elementary import log
from plant_fmu.flexible_manipulator.jit import callable_from_compiled

from ..jit import compiled
from . import scenario

for _function in (scenario.later, scenario.latest, scenario.turned):
    callable_from_compiled(_function)

chirp, pulse = compiled(scenario.chirp), compiled(scenario.pulse)


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


def normal_numbers(stream: np.random.RandomState, count: int) -> np.ndarray:
    """``count`` independent standard normal numbers by Marsaglia's polar method, shape (count,).

    They are those of NumPy's ``standard_normal`` but for the last bit: its logarithm is that of the C library.
    """
    numbers = np.zeros(0)
    while numbers.size < count:
        # Of the pairs in a square, pi / 4 are within the circle, so one round too few is usual, and the rest follows.
        missing = count - numbers.size
        pairs = 2.0 * stream.random_sample((missing - missing // 4, 2)) - 1.0  # pi / 4 of them are within the circle
        squares = pairs[:, 0] * pairs[:, 0] + pairs[:, 1] * pairs[:, 1]
        within = (squares < 1.0) & (squares != 0.0)
        factors = squares[within]
        _polar(factors)
        # Both numbers of a pair are used, the second one first: the order of NumPy's
        # legacy generator, whose bits these are but for the logarithm.
        numbers = np.concatenate([numbers, (factors[:, None] * pairs[within, ::-1]).ravel()])
    return numbers[:count]


@compiled
def _polar(squares: np.ndarray) -> None:
    for i in range(squares.size):
        squares[i] = math.sqrt(-2.0 * log(squares[i]) / squares[i])
