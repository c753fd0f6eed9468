"""The figures of a trajectory in one pass over its samples, compiled.

Nothing but +, -, *, sqrt, absolute values and comparisons, each rounded as IEEE 754 says: the same bits on every
platform.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..jit import compiled


class Places(NamedTuple):
    """Sample numbers: ``end`` is the first one after the case's own end; where chirp and force begin, the force has
    ended, and the time begins in which the loop has to rest."""

    end: int
    chirp: int
    force: int
    release: int
    rest: int


class Scan(NamedTuple):
    """What :func:`scan` reads: per axis the largest distance from the start torque and the largest torque [N.m]; the
    largest TCP errors from the force on, from the chirp to the force, and at rest [m]; the last samples after the force
    with an error of ``settling`` and of ``recovery`` or more (-1: none); and half the peak-to-peak of x and z [m] in
    each window, shape (windows, 2)."""

    noise: tuple[float, float]
    torque: tuple[float, float]
    force_error: float
    chirp_error: float
    rest_error: float
    settling: int
    recovery: int
    amplitudes: np.ndarray


def scan(
    X: np.ndarray,
    torque: np.ndarray,
    u_m0: tuple[float, float],
    places: Places,
    windows: np.ndarray,
    settling: float,
    recovery: float,
) -> Scan:
    """Read the TCP's positions ``X`` and the torques; ``windows`` are the numbers of the windows' first samples, the
    last of which goes on to the last sample."""
    figures, extremes = np.zeros(7), np.empty((len(windows), 4))
    late, later = pass_over(X, torque, u_m0, places, windows, settling, recovery, figures, extremes)
    noise_1, noise_2, torque_1, torque_2, force, chirp, rest = figures.tolist()
    amplitudes = 0.5 * (extremes[:, 1::2] - extremes[:, 0::2])
    return Scan((noise_1, noise_2), (torque_1, torque_2), force, chirp, rest, late, later, amplitudes)


@compiled
def pass_over(
    X: np.ndarray,
    torque: np.ndarray,
    u_m0: tuple[float, float],
    places: Places,
    windows: np.ndarray,
    settling: float,
    recovery: float,
    figures: np.ndarray,
    extremes: np.ndarray,
) -> tuple[int, int]:
    """Fill the ``figures`` in the order of :class:`Scan`, and the smallest and largest x and z of each window; gives
    the two last samples."""
    late = later = -1
    window = -1
    x_0, z_0 = X[0, 0], X[0, 1]
    for k in range(X.shape[0]):
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
        if window + 1 < windows.shape[0] and k == windows[window + 1]:
            window += 1
            extremes[window, 0] = extremes[window, 1] = x
            extremes[window, 2] = extremes[window, 3] = z
        elif window >= 0:
            extremes[window, 0] = min(extremes[window, 0], x)
            extremes[window, 1] = max(extremes[window, 1], x)
            extremes[window, 2] = min(extremes[window, 2], z)
            extremes[window, 3] = max(extremes[window, 3], z)
    return late, later


def warm_up() -> None:
    """Load, or once compile, the machine code for the arrays of the master loop."""
    # Not contiguous, as columns of the record are: Numba compiles for the layout as well.
    X, torque = np.zeros((2, 4))[:, 2:], np.zeros((1, 2))
    scan(X, torque, (0.0, 0.0), Places(2, 0, 0, 0, 0), np.zeros(1, dtype=np.int64), 0.0, 0.0)
