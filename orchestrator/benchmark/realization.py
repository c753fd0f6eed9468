"""A linear system from its impulse response: the realization of Ho and Kalman (1966), as of Juang and Pappa (1985).

The Hankel matrix of a response h has the blocks h[i + j] of chosen rows i and columns j. These need not be consecutive:
dense ones see fast modes, sparse ones slow modes and integrators, both with a small matrix.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from .loop_analysis import StateSpace

# Imports inside functions: SciPy takes longer to load than all else here.

SPARSE, DENSE = 25, 25
"""Rows and columns of blocks: one after the other, then at equal ratios."""

NOISE = 1e-12
"""Singular values below this, relative to the largest, are rounding."""

MOST_STATES = 40
"""States that a realization has at most."""


def realizations(impulse: np.ndarray, T_s: float) -> Iterator[StateSpace]:
    """Systems with the impulse response ``impulse`` (shape (N, outputs, inputs), first the feedthrough), sampled every
    ``T_s`` [s]: with one state, two states, and so on, as far as the response tells them from rounding."""
    from scipy.linalg import svd

    D, h = impulse[0], impulse[1:]
    length, outputs, inputs = h.shape
    chosen = _places((length - 1) // 2)
    now = _hankel(h, chosen, 0)
    later = _hankel(h, chosen, 1)
    left, sizes, right = svd(now)
    most = int(np.sum(sizes > NOISE * sizes[0])) if sizes[0] > 0.0 else 0
    yield StateSpace(np.zeros((0, 0)), np.zeros((0, inputs)), np.zeros((outputs, 0)), D, T_s)
    for order in range(1, min(most, MOST_STATES) + 1):
        root = np.sqrt(sizes[:order])
        out, back = left[:, :order] / root, right[:order].T / root
        A = out.T @ later @ back
        # The first block row and column are those of the place 0.
        yield StateSpace(A, root[:, None] * right[:order, :inputs], left[:outputs, :order] * root, D, T_s)


def simulated(system: StateSpace, inputs: np.ndarray) -> np.ndarray:
    """Outputs of a sampled system from rest; ``inputs`` has the shape (N, inputs)."""
    x, found = np.zeros(len(system.A)), np.empty((len(inputs), len(system.D)))
    for k, u in enumerate(inputs):
        found[k] = system.C @ x + system.D @ u
        x = system.A @ x + system.B @ u
    return found


def _places(end: int) -> np.ndarray:
    """Rows or columns of the Hankel matrix, up to ``end``."""
    return np.unique(np.concatenate([np.arange(DENSE), np.geomspace(DENSE, end, SPARSE).astype(int)]))


def _hankel(h: np.ndarray, places: np.ndarray, shift: int) -> np.ndarray:
    """The Hankel matrix of blocks of ``h`` at these places, ``shift`` samples on."""
    blocks: np.ndarray = h[places[:, None] + places[None, :] + shift]
    rows, columns, outputs, inputs = blocks.shape
    stacked: np.ndarray = blocks.transpose(0, 2, 1, 3).reshape(rows * outputs, columns * inputs)
    return stacked
