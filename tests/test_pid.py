"""The PID's law against eq. (13), and the FMI 2.0 co-simulation FMUs of all controllers against their laws."""

from __future__ import annotations

import json
import runpy
from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from fmpy import read_model_description
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from scipy import signal
from support.pid_fmus import GAINS, OUTPUTS, T_S, Signals, built, in_child, law, live, random_signals
from support.tools import require

import build_fmus
from benchmarks.tuning import friction, pid_tuned
from benchmarks.tuning import lqg as plain
from controller_fmu.friction import flexible_manipulator_dither as shaking
from controller_fmu.lqg.flexible_manipulator_lqg import design as lqg
from controller_fmu.lqg.flexible_manipulator_lqg.interface import Weights, chosen

CONTROLLERS = Path(build_fmus.__file__).parent / "controller_fmu"
STARTS = {
    task.shipped: json.loads(task.file.read_text(encoding="utf-8"))["parameters"]
    for task in (pid_tuned.TASK, plain.TASK, friction.TASK)
}
"""Start values of the parameters in the data files."""
TUNED = {name: (STARTS["TunedPID"][f"{name}[1]"], STARTS["TunedPID"][f"{name}[2]"]) for name in GAINS}
PIDS = {"DiagonalPID": GAINS, "DiagonalPID_C": GAINS, "TunedPID": TUNED}
LQGS = {name: STARTS[name.removesuffix("_C")] for name in ("ManipulatorLQG", "DitheredLQG", "DitheredLQG_C")}
LAW = SimpleNamespace(**runpy.run_path(str(CONTROLLERS / "pid" / "diagonal_pid_fmu.py")))
AT = (60.0, -180.0)
"""Motor angles of a pose in the workspace [rad]."""


# ---- The law ----


def response_of_equation_13(errors, K_p, K_i, K_d, z_p):
    """Eq. (13) over its common denominator (z - z_p)(z - 1)."""
    pole, integrator, z = np.poly([z_p]), np.poly([1.0]), np.array([1.0, 0.0])
    proportional = K_p * np.polymul(pole, integrator)
    derivative = K_d * (1.0 - z_p) / T_S * np.polymul(integrator, integrator)
    integral = K_i * T_S * np.polymul(z, pole)
    numerator = np.polyadd(np.polyadd(proportional, derivative), integral)
    system = signal.dlti(numerator, np.polymul(pole, integrator), dt=T_S)
    _, torques = signal.dlsim(system, errors)
    return torques[:, 0]


gain = st.floats(0.01, 100.0)
error_sequences = arrays(float, st.integers(1, 60), elements=st.floats(-1.0, 1.0, allow_subnormal=False))


@given(errors=error_sequences, K_p=gain, K_i=gain, K_d=gain, z_p=st.floats(0.0, 0.99), u_m0=st.floats(-50.0, 50.0))
def test_law_is_equation_13_about_the_start_torque(errors, K_p, K_i, K_d, z_p, u_m0):
    gains, state, torques = LAW.Gains(K_p, K_i, K_d, z_p, T_S), (0.0, 0.0, u_m0), []
    for e in errors.tolist():
        state = LAW.sample(gains, state, e)
        torques.append(LAW.torque(gains, state))
    expected = u_m0 + response_of_equation_13(errors, K_p, K_i, K_d, z_p)
    scale = K_p + K_d / T_S + K_i * T_S * len(errors)
    assert_allclose(torques, expected, rtol=0.0, atol=1e-10 * scale)


# ---- The FMUs ----


def near_rest(samples: int) -> Signals:
    """Measurements scattered about the reference AT, more and more: from 0.1 mrad to 30 mrad, and into the limits."""
    scatter = np.geomspace(1e-4, 0.03, samples)[:, np.newaxis] * np.random.default_rng(3).normal(size=(samples, 2))
    return Signals(np.tile(AT, (samples, 1)), np.array(AT) + scatter, (1.7, -0.3))


def recursion(signals: Signals, values: Mapping[str, float]) -> np.ndarray:
    """Torques [N.m] of the design with the parameters ``values``, as plainly as can be."""
    plan = lqg.controller(chosen(Weights, values), lqg.pose(AT, signals.u_m0), T_S)
    wave = shaking.wave(chosen(shaking.Dither, values), T_S) if "period" in values else None
    z, u, level, torques = np.zeros(12), np.zeros(2), 0.0, []
    for k, (reference, measured) in enumerate(zip(signals.q_m_ref, signals.q_m, strict=True)):
        z = plan.step @ np.concatenate([z, u, measured - reference])
        u = -plan.gain @ z
        if wave:
            level, *shake = shaking.dither(wave, level, float(np.linalg.norm(plan.tool @ z)), k)
            u = np.clip(np.add(signals.u_m0, u) + shake, [-35.0, -20.0], [35.0, 20.0]) - signals.u_m0
        torques.append(np.add(signals.u_m0, u))
    return np.array(torques)


WRONG_STEPS = (2 * T_S, T_S * 1.02, float("nan"))
WRONG_SAMPLE_TIMES = (("T_s", 0.0), ("T_s", float("inf")))
WRONG_PARAMETERS = {
    "PID": (("z_p[2]", 1.0), ("z_p[1]", float("nan"))),
    "LQG": (("effort[2]", 0.0), ("hardening", float("nan"))),
}


@pytest.fixture(scope="module", params=[*PIDS, *LQGS])
def lived(request, fmu_folder):
    """A controller's FMU, the signals it got, what it did, and the parameters that it had to refuse."""
    if request.param.endswith("_C"):
        require("compiler")
    file = built(request.param, fmu_folder)
    signals, at = (random_signals(), (0.0, 0.0)) if file.stem in PIDS else (near_rest(400), AT)
    wrong = WRONG_SAMPLE_TIMES + WRONG_PARAMETERS["PID" if file.stem in PIDS else "LQG"]
    return file, signals, in_child(live, file, signals, at, WRONG_STEPS, wrong), wrong


def test_torques_are_the_laws_whatever_the_state_came_from(lived):
    file, signals, life, _ = lived
    straight, *others = life["runs"]
    assert all(run == straight for run in others) and len(others) == 4
    assert life["restored"] == [straight[len(straight) // 2 - 1]] * 2
    assert life["initial"] == signals.u_m0, "outputs follow u_m0 during initialization"
    if file.stem in PIDS:
        assert straight == law(signals, PIDS[file.stem])
    else:
        assert np.abs(straight).max() > 20.0, "into the limits"
        assert_allclose(straight, recursion(signals, LQGS[file.stem]), rtol=1e-7, atol=1e-7)


def test_wrong_steps_and_parameters_are_refused_with_a_reason(lived):
    file, _, life, wrong = lived
    early = "fmi2SetReal" if file.stem.endswith("_C") else "fmi2ExitInitializationMode"
    calls = ["fmi2ExitInitializationMode" if np.isfinite(value) else early for _, value in wrong]
    assert life["failed"] == ["fmi2DoStep"] * len(WRONG_STEPS) + calls
    assert life["unchanged"] == (0.0, 0.0)
    steps = [step for step in WRONG_STEPS if np.isfinite(step)]
    assert life["log"].count("the communication step must equal the sample time T_s = 0.00025") >= len(steps)
    assert all(f"step of {step:.15g} s at t = 0" in life["log"] for step in WRONG_STEPS)
    assert life["log"].count("T_s = 0 s: ") + life["log"].count("T_s = 0.0 s: ") == 1
    assert all(f"{name} = {value:g}" in life["log"] for name, value in wrong)


def test_start_values_are_the_described_ones(lived):
    file, _, life, _ = lived
    variables = read_model_description(str(file)).modelVariables
    described = {v.name: float(v.start) for v in variables if v.start is not None}
    assert life["started"] == tuple(described.values())
    for name, values in PIDS.get(file.stem, {}).items():
        assert (described[f"{name}[1]"], described[f"{name}[2]"]) == tuple(values)
    assert LQGS.get(file.stem, {}).items() <= described.items()


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", ["DiagonalPID", "DitheredLQG"])
def test_twins_have_the_same_interface(name, fmu_folder):
    def interface(file):
        return [
            (v.name, v.valueReference, v.causality, v.variability, v.unit, v.start and float(v.start), v.description)
            for v in read_model_description(str(file)).modelVariables
        ]

    here, there = (interface(built(kind, fmu_folder)) for kind in (name, f"{name}_C"))
    assert here == there
    assert tuple(row[0] for row in here if row[2] == "output") == OUTPUTS
