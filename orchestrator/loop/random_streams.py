"""Random numbers that a seed determines for good."""

from __future__ import annotations

import functools
import math

import numpy as np

from plant_fmu.flexible_manipulator.elementary import log

from ..jit import compiled
from .scenario import Noise


def stable_stream(seed: tuple[int, ...]) -> np.random.RandomState:
    """The stream of a seed.

    NumPy guarantees the streams of its bit generators and of the frozen ``RandomState``, but not those of
    ``Generator``; a benchmark's noise has to outlive a library's next version.
    """
    return np.random.RandomState(np.random.PCG64(np.random.SeedSequence(seed)))


def normal_numbers(stream: np.random.RandomState, count: int) -> np.ndarray:
    """``count`` independent standard normal numbers by Marsaglia's polar method, shape (count,).

    They are those of NumPy's ``standard_normal`` but for the last bit: its logarithm is that of the C library.
    """
    found = np.zeros(0)
    while found.size < count:
        missing = count - found.size
        pairs = 2.0 * stream.random_sample((missing - missing // 4, 2)) - 1.0  # pi / 4 of them are within the circle
        squares = pairs[:, 0] * pairs[:, 0] + pairs[:, 1] * pairs[:, 1]
        within = (squares < 1.0) & (squares != 0.0)
        factors = squares[within]
        _polar(factors)
        found = np.concatenate([found, (factors[:, None] * pairs[within, ::-1]).ravel()])
    return found[:count]


@compiled
def _polar(squares: np.ndarray) -> None:
    for i in range(squares.size):
        squares[i] = math.sqrt(-2.0 * log(squares[i]) / squares[i])


@functools.lru_cache(maxsize=4)  # a system has the same noise in all its tests, and a worker runs several
def noise(spec: Noise, samples: int) -> np.ndarray:
    """Measurement noise [rad] of shape (samples, 2), read-only."""
    numbers = np.zeros((samples, 2))
    if spec.sigma != 0.0:
        numbers[:] = normal_numbers(stable_stream(spec.seed), 2 * samples).reshape(samples, 2)
        numbers *= spec.sigma
    numbers.flags.writeable = False
    return numbers
