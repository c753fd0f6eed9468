"""The figures of a trajectory in one pass over its samples, and how far the TCP moves in a window; compiled.

Nothing but +, -, *, sqrt, absolute values and comparisons, each rounded as IEEE 754 says: the same bits on every
platform.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from plant_fmu.flexible_manipulator.formulas import sin_cos

from ..jit import compiled

DIRECTIONS = 32
"""Directions in which the TCP's path is measured, at equal angles over half a turn. The line between the two points
that are farthest apart is at most pi / 64 away from one of them: the largest extent falls short of their distance by
at most the share :data:`SHORTER`, however the axes lie."""

SHORTER = 0.00121
"""1 - cos(pi / (2 DIRECTIONS)), rounded upwards."""

# Of the benchmark's own sine, whose bits are the same everywhere.
SINES, COSINES = (
    np.array(column) for column in zip(*(sin_cos(math.pi * k / DIRECTIONS) for k in range(DIRECTIONS)), strict=True)
)


ALL = 2**62
"""More samples than there are."""


class Places(NamedTuple):
    """Sample numbers: ``end`` is the first one after the case's own end; where chirp and force begin, the force has
    ended, and the time begins in which the loop has to rest. Read are the samples from ``first`` on and before
    ``until``: all, or those of one repetition of the disturbances."""

    end: int
    chirp: int
    force: int
    release: int
    rest: int
    first: int = 0
    until: int = ALL

    @property
    def last(self) -> int:
        """The last sample that the time to settle is measured in."""
        return min(self.until, self.end) - 1


class Scan(NamedTuple):
    """What :func:`scan` reads: per axis the largest distance from the start torque and the largest torque [N.m]; the
    largest TCP errors from the force on, from the chirp to the force, and at rest [m]; and the last samples after the
    force with an error of ``settling`` and of ``recovery`` or more (-1: none)."""

    noise: tuple[float, float]
    torque: tuple[float, float]
    force_error: float
    chirp_error: float
    rest_error: float
    settling: int
    recovery: int


def scan(
    X: np.ndarray,
    torque: np.ndarray,
    u_m0: tuple[float, float],
    places: Places,
    settling: float,
    recovery: float,
) -> Scan:
    """Read the TCP's positions ``X``, shape (samples, 2), and the torques."""
    figures = np.zeros(7)
    late, later = pass_over(X, torque, u_m0, places, settling, recovery, figures)
    noise_1, noise_2, torque_1, torque_2, force, chirp, rest = figures.tolist()
    return Scan((noise_1, noise_2), (torque_1, torque_2), force, chirp, rest, late, later)


def amplitudes(X: np.ndarray) -> np.ndarray:
    """Half the extent [m] of the TCP's path ``X``, shape (samples, 2), in each of the DIRECTIONS; the largest is half
    the largest distance between two points of the path."""
    lowest, highest = np.zeros(DIRECTIONS), np.zeros(DIRECTIONS)
    project(X, COSINES, SINES, lowest, highest)
    return 0.5 * (highest - lowest)


@compiled
def pass_over(
    X: np.ndarray,
    torque: np.ndarray,
    u_m0: tuple[float, float],
    places: Places,
    settling: float,
    recovery: float,
    figures: np.ndarray,
) -> tuple[int, int]:
    """Fill the ``figures`` in the order of :class:`Scan`; gives the two last samples."""
    late = later = -1
    x_0, z_0 = X[0, 0], X[0, 1]
    for k in range(places.first, min(X.shape[0], places.until)):
        x, z = X[k, 0], X[k, 1]
        # Not hypot: its last bit is the C library's.
        error = np.sqrt((x - x_0) * (x - x_0) + (z - z_0) * (z - z_0))
        if k < places.end:
            if k >= places.force:
                figures[4] = max(figures[4], error)
            elif k >= places.chirp:
                figures[5] = max(figures[5], error)
            if k >= places.release:
                if error >= settling:
                    late = k
                if error >= recovery:
                    later = k
        if k >= places.rest:
            figures[6] = max(figures[6], error)
        # Torques have a row less than positions.
        if k + 1 < places.end:
            for axis in range(2):
                u = torque[k, axis]
                figures[axis] = max(figures[axis], abs(u - u_m0[axis]))
                figures[2 + axis] = max(figures[2 + axis], abs(u))
    return late, later


@compiled
def project(X: np.ndarray, cosines: np.ndarray, sines: np.ndarray, lowest: np.ndarray, highest: np.ndarray) -> None:
    """Fill the ``lowest`` and ``highest`` place of a path in each direction, seen from its first point [m]."""
    # From there, as products of a whole metre would be rounded by 1e-16 m.
    x_0, z_0 = X[0, 0], X[0, 1]
    for k in range(X.shape[0]):
        x, z = X[k, 0] - x_0, X[k, 1] - z_0
        for n in range(cosines.shape[0]):
            place = x * cosines[n] + z * sines[n]
            lowest[n] = min(lowest[n], place)
            highest[n] = max(highest[n], place)


def warm_up() -> None:
    """Load, or once compile, the machine code for the arrays of the master loop."""
    # Not contiguous, as columns of the record are: Numba compiles for the layout as well.
    X, torque = np.zeros((2, 4))[:, 2:], np.zeros((1, 2))
    scan(X, torque, (0.0, 0.0), Places(2, 0, 0, 0, 0), 0.0, 0.0)
    amplitudes(X)
