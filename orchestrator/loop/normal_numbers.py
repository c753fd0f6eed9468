"""Normal random numbers that have the same bits on every platform."""

from __future__ import annotations

import math

import numpy as np

from plant_fmu.flexible_manipulator.elementary import log

from ..jit import compiled


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
