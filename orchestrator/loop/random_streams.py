"""Random numbers that a seed determines for good."""

from __future__ import annotations

import functools

import numpy as np

from .scenario import Noise


def stable_stream(seed: tuple[int, ...]) -> np.random.RandomState:
    """The stream of a seed.

    NumPy guarantees the streams of its bit generators and of the frozen ``RandomState``, but not those of
    ``Generator``; the benchmark's noise must not change with a new version of NumPy.
    """
    return np.random.RandomState(np.random.PCG64(np.random.SeedSequence(seed)))


@functools.lru_cache(maxsize=4)  # a system has the same noise in all its tests, and a worker runs several
def noise(spec: Noise, samples: int) -> np.ndarray:
    """Measurement noise [rad] of shape (samples, 2), read-only."""
    numbers = np.zeros((samples, 2))
    if spec.sigma != 0.0:
        from .normal_numbers import normal_numbers  # loads Numba, which only simulations need

        numbers[:] = normal_numbers(stable_stream(spec.seed), 2 * samples).reshape(samples, 2)
        numbers *= spec.sigma
    numbers.flags.writeable = False
    return numbers
