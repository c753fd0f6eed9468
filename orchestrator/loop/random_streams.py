"""Random numbers that a seed determines for good."""

from __future__ import annotations

import functools

import numpy as np

from .scenario import Noise

DROPOUT, JITTER = (0, 1), (0, 2)
"""Words behind those of the noise, for streams of their own."""


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
        from .signals import normal_numbers  # loads Numba, which only simulations need

        numbers[:] = normal_numbers(stable_stream(spec.seed), 2 * samples).reshape(samples, 2)
        numbers *= spec.sigma
    # It is cached: who wrote into it would change the noise of the next case.
    numbers.flags.writeable = False
    return numbers


def dropped(seed: tuple[int, ...], probability: float, samples: int) -> np.ndarray:
    """Which samples are lost, bool, shape (samples,), with the ``seed`` words of the noise.

    Each is lost with this probability, independently of the others. More samples begin with the same ones, and those
    that are lost at a probability are lost at all higher ones.
    """
    if probability == 0.0:
        return np.zeros(samples, dtype=np.bool_)
    lost: np.ndarray = stable_stream((*seed, *DROPOUT)).random_sample(samples) < probability
    return lost


def jitter_cells(seed: tuple[int, ...], cells: int, samples: int) -> np.ndarray:
    """A number from 0 to ``cells`` - 1 for each sample, all equally likely, int64, shape (samples,), with the ``seed``
    words of the noise. More samples begin with the same ones."""
    return (cells * stable_stream((*seed, *JITTER)).random_sample(samples)).astype(np.int64)
