"""Policies: every way to an FMU gives the torques of the same network, and an episode is a simulation."""

import shutil
import sys
import warnings
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest
from fmpy.validation import validate_fmu
from support.pid_fmus import T_S, in_child, live, random_signals
from support.refusals import refusal

from controller_fmu import controller_from_mlp, errors, starters
from controller_fmu.export import build_folder, find_compiler
from orchestrator import Benchmark, Controller, Variation

needs_compiler = pytest.mark.skipif(find_compiler() is None, reason="no C compiler")

LAW = np.kron([45.0, 1.5, 30.0, 0.0], np.diag([1.0, 0.0])) + np.kron([15.0, 0.5, 10.0, 0.0], np.diag([0.0, 1.0]))
"""The paper's PID, of the eight numbers of an observation."""


def network(activation, scale, hidden=7, seed=3):
    """A network of two hidden layers: where it is not saturated, and ``scale`` is small, some linear law."""
    random = np.random.default_rng(seed)
    W1, W2, W3 = (random.normal(size=shape) for shape in ((hidden, 8), (5, hidden), (2, 5)))
    biases = {f"b{k}": scale * random.normal(size=size) for k, size in ((1, hidden), (2, 5), (3, 2))}
    return {"W1": scale * W1, "W2": W2, "W3": W3, **biases, "activation": activation}


def torques(weights, q_m_ref, q_m, u_m0):
    """What the page says of a policy, as plainly as can be: shape (samples, 2)."""
    act = {"tanh": np.tanh, "relu": lambda x: x * (x > 0.0)}[weights["activation"]]
    e = q_m_ref - q_m
    s = T_S * np.cumsum(e, axis=0)
    v, rows = np.zeros(2), []
    for now, before in zip(e, np.vstack([np.zeros(2), e]), strict=False):
        v = 0.95 * v + 0.05 * (now - before) / T_S
        rows.append(v)
    x = np.hstack([e, rows, s, np.broadcast_to(q_m_ref, e.shape)])
    depth = len(weights) // 2
    for k in range(1, depth + 1):
        x = x @ np.asarray(weights[f"W{k}"]).T + weights[f"b{k}"]
        x = act(x) if k < depth else x
    return x + u_m0


@needs_compiler
@pytest.mark.parametrize(("activation", "scale"), [("tanh", 0.01), ("relu", 1.0)])
def test_a_network_in_c_has_the_torques_of_its_layers(activation, scale, tmp_path, monkeypatch):
    """From the start and from restored states; without a warning of the compiler."""
    strict = "-Wall -Wextra -Wno-unused-parameter -pedantic -Werror"
    monkeypatch.setenv("CC", f"{' '.join(find_compiler())} {strict}")
    weights = network(activation, scale)
    np.savez(tmp_path / "policy.npz", **weights)
    file = controller_from_mlp(tmp_path / "policy.npz", out=tmp_path / "policy.fmu")
    assert validate_fmu(str(file)) == []
    assert controller_from_mlp(weights, out=file).read_bytes() == file.read_bytes()
    signals = random_signals()
    expected = torques(weights, signals.q_m_ref, signals.q_m, signals.u_m0)
    assert np.ptp(expected, axis=0).min() > 0.5
    life = in_child(live, file, signals, (0.0, 0.0), [], [])
    assert life["initial"] == signals.u_m0 and len(life["runs"]) == 5
    for run in life["runs"]:
        np.testing.assert_allclose(run, expected, rtol=1e-11)
