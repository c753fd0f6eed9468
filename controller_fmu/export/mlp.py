"""A controller FMU of a multilayer perceptron, compiled."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from controller_fmu.errors import NetworkError, located
from controller_fmu.export.archive import target_of
from controller_fmu.export.c_fmu import c_fmu
from controller_fmu.export.description import parse, to_bytes
from controller_fmu.starters.policy.manipulator_observation import SIZE

FOLDER = Path(__file__).resolve().parents[1]
MODEL = FOLDER / "mlp" / "model.c"
DESCRIPTION = FOLDER / "state_space" / "modelDescription.xml"
"""That of another controller with the same variables."""

ACTIVATIONS = {"tanh": "elementary_tanh(x)", "relu": "((x) <= 0.0 ? 0.0 : (x))"}
"""In C, by name; what is not a number stays so."""

TORQUES = 2


def controller_from_mlp(weights: Mapping[str, Any] | str | Path, *, out: str | Path) -> Path:
    """Build the FMU of a policy, ``u_m = u_m0 + network(observation)``, in C, and return its path ``out``.

    The observation is that of the starter kits in NumPy and ONNX (``docs/policies.md``), of eight numbers. The
    activation follows every layer but the last::

        x = activation(W1 x + b1), x = activation(W2 x + b2), ..., torque = WL x + bL       [N.m]

    Parameters
    ----------
    weights : mapping or path
        The arrays ``W1``, ``b1``, ``W2``, ``b2``, ..., of shapes (outputs, inputs) and (outputs,) as those of PyTorch's
        ``nn.Linear``, and ``activation``, ``"tanh"`` or ``"relu"``; or a ``.npz`` file with them.
    out : path
        The FMU to write; its name becomes the model's, and must be a C identifier.

    Raises
    ------
    NetworkError
        If the file cannot be read, or the weights are no such network.
    BuildError
        Whatever else is wrong with ``out`` or the compiler.
    """
    target = target_of(out)
    if not isinstance(weights, Mapping | str | os.PathLike):
        raise NetworkError(f"the weights are a mapping or the path of a file, not {weights!r:.60}", str(target))
    with located(target if isinstance(weights, Mapping) else Path(weights)):
        stored = weights if isinstance(weights, Mapping) else _contents(Path(weights))
        layers, activation = _layers(stored), str(stored.get("activation", ""))
        if activation not in ACTIVATIONS:
            what = f"there is no activation {activation!r}" if activation else "has no activation"
            raise NetworkError(what, value=activation, nearest=tuple(ACTIVATIONS))
    root = parse(DESCRIPTION.read_bytes())
    root.set("description", "Policy: u_m = u_m0 + network(observation)")
    root.find("DefaultExperiment").set("stepSize", "0.00025")  # type: ignore[union-attr]  # it is there
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as name:
        folder = Path(name)
        (folder / "modelDescription.xml").write_bytes(to_bytes(root))
        (folder / "weights.h").write_text(_header(layers, activation), encoding="utf-8")
        return c_fmu([MODEL, folder / "weights.h"], folder / "modelDescription.xml", target)


def _contents(file: Path) -> dict[str, Any]:
    try:
        with np.load(file) as stored:
            return dict(stored)
    except Exception as problem:  # NumPy, zipfile and zlib have all kinds for damaged files
        raise NetworkError(f"cannot be read: {problem}", str(file)) from None


def _layers(stored: Mapping[str, Any]) -> list[tuple[np.ndarray, np.ndarray]]:
    """W and b of each layer, which fit each other, the observation and the torques."""
    names = {f"{kind}{k}" for k in range(1, len(stored) // 2 + 1) for kind in "Wb"}
    if not names or set(stored) - {"activation"} != names:
        present = ", ".join(sorted(stored)) or "nothing"
        raise NetworkError(f"holds {present}, and not W1, b1, W2, b2, ... and activation", value=present)
    layers, width = [], SIZE
    for k in range(1, len(names) // 2 + 1):
        W, b = (np.asarray(stored[f"{kind}{k}"]) for kind in "Wb")
        if W.ndim != 2 or b.shape != W.shape[:1] or W.shape[1] != width:
            what = f"W{k} and b{k} have the shapes {W.shape} and {b.shape}, not (n, {width}) and (n,)"
            raise NetworkError(what, value=f"W{k}")
        if (
            W.dtype.kind not in "fiu"
            or b.dtype.kind not in "fiu"
            or not (np.isfinite(W).all() and np.isfinite(b).all())
        ):
            raise NetworkError(f"W{k} or b{k} holds what is not a finite number", value=f"W{k}")
        width = len(b)
        layers.append((W.astype(float), b.astype(float)))
    if width != TORQUES:
        raise NetworkError(f"the last layer has {width} outputs, not two torques", value=f"W{len(layers)}")
    return layers


def _header(layers: list[tuple[np.ndarray, np.ndarray]], activation: str) -> str:
    """The network as C, the matrices by columns."""
    sizes = [SIZE, *(len(b) for _, b in layers)]
    numbers = np.concatenate([part for W, b in layers for part in (W.T.ravel(), b)]).tolist()
    return f"""/* Written by the build: the network. */
#ifndef WEIGHTS_H
#define WEIGHTS_H

enum {{ LAYERS = {len(layers)}, WIDTH = {max(sizes)} }};

#define ACTIVATION(x) {ACTIVATIONS[activation]}

static const int SIZE[LAYERS + 1] = {{{", ".join(map(str, sizes))}}};
static const double WEIGHTS[] = {{
{",".join(map(repr, numbers))}
}};

#endif
"""
