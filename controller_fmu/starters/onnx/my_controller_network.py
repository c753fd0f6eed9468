"""The network, evaluated by ONNX Runtime: policy.onnx with one input, shape (1, 8), and an output of shape (1, 2)."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import onnxruntime

TYPES = {"tensor(double)": np.float64, "tensor(float)": np.float32}


def load(folder: Path) -> Callable[[np.ndarray], np.ndarray]:
    """Return the function from an observation, shape (8,), to the torques [N.m] to add to u_m0, shape (2,)."""
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1  # cases run side by side already
    session = onnxruntime.InferenceSession(folder / "policy.onnx", options, providers=["CPUExecutionProvider"])
    (given,) = session.get_inputs()
    kind = TYPES[given.type]
    return lambda x: session.run(None, {given.name: x.astype(kind)[None]})[0][0]
