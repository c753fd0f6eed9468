"""The network, evaluated by NumPy: the layers W1, b1, W2, b2, ... and the name of the activation in policy.npz."""

from collections.abc import Callable
from pathlib import Path

import numpy as np

Function = Callable[[np.ndarray], np.ndarray]

ACTIVATIONS: dict[str, Function] = {"tanh": np.tanh, "relu": lambda x: np.maximum(x, 0.0)}


def load(folder: Path) -> Function:
    """Return the function from an observation, shape (8,), to the torques [N.m] to add to u_m0, shape (2,)."""
    with np.load(folder / "policy.npz") as stored:
        names = range(1, sum(name.startswith("W") for name in stored) + 1)
        *hidden, (W_last, b_last) = [(stored[f"W{k}"], stored[f"b{k}"]) for k in names]
        activation = ACTIVATIONS[str(stored["activation"])]

    def network(x: np.ndarray) -> np.ndarray:
        for W, b in hidden:
            x = activation(W @ x + b)
        torque: np.ndarray = W_last @ x + b_last
        return torque

    return network
