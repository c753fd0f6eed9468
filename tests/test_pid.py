"""The default controller: its law against eq. (13), and its FMUs against its law."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description
from fmpy.fmi1 import FMICallException
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pid_fmus import GAINS, OUTPUTS, T_S, in_child, law, random_signals, slave

import build_fmus

FMUS = ("DiagonalPID", "DiagonalPID_C")
SCRIPT = Path(build_fmus.__file__).parent / "controller_fmu" / "pid" / "diagonal_pid_fmu.py"


@pytest.fixture(scope="module")
def pid_module():
    specification = importlib.util.spec_from_file_location("diagonal_pid_fmu_under_test", SCRIPT)
    module = importlib.util.module_from_spec(specification)
    sys.modules[specification.name] = module
    specification.loader.exec_module(module)
    yield module
    del sys.modules[specification.name]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module", params=FMUS)
def fmu(request, folder):
    if request.param.endswith("_C") and build_fmus.find_compiler() is None:
        pytest.skip("no C compiler")
    return build_fmus.build(request.param, folder)


# ---- The law ----


def response_of_equation_13(errors, K_p, K_i, K_d, z_p):
    """Eq. (13) over its common denominator (z - z_p)(z - 1)."""
    from scipy import signal  # here, because every child imports this module and scipy.signal takes a second

    pole, integrator, z = np.poly([z_p]), np.poly([1.0]), np.array([1.0, 0.0])
    proportional = K_p * np.polymul(pole, integrator)
    derivative = K_d * (1.0 - z_p) / T_S * np.polymul(integrator, integrator)
    integral = K_i * T_S * np.polymul(z, pole)
    numerator = np.polyadd(np.polyadd(proportional, derivative), integral)
    system = signal.dlti(numerator, np.polymul(pole, integrator), dt=T_S)
    _, torques = signal.dlsim(system, errors)
    return torques[:, 0]


def torques_of(pid_module, gains, errors, u_m0=0.0):
    state = (0.0, 0.0, u_m0)
    torques = []
    for e in errors:
        state = pid_module.sample(gains, state, float(e))
        torques.append(pid_module.torque(gains, state))
    return np.array(torques)


gain = st.floats(0.01, 100.0)
error_sequences = arrays(float, st.integers(1, 60), elements=st.floats(-1.0, 1.0, allow_subnormal=False))


@given(errors=error_sequences, K_p=gain, K_i=gain, K_d=gain, z_p=st.floats(0.0, 0.99))
def test_law_is_equation_13(pid_module, errors, K_p, K_i, K_d, z_p):
    expected = response_of_equation_13(errors, K_p, K_i, K_d, z_p)
    torques = torques_of(pid_module, pid_module.Gains(K_p, K_i, K_d, z_p, T_S), errors)
    scale = K_p + K_d / T_S + K_i * T_S * len(errors)
    np.testing.assert_allclose(torques, expected, rtol=0.0, atol=1e-10 * scale)


@given(errors=error_sequences, u_m0=st.floats(-50.0, 50.0))
def test_start_torque_is_an_offset(pid_module, errors, u_m0):
    gains = pid_module.Gains(45.0, 30.0, 1.5, 0.95, T_S)
    offset = torques_of(pid_module, gains, errors, u_m0) - torques_of(pid_module, gains, errors)
    np.testing.assert_allclose(offset, u_m0, rtol=0.0, atol=1e-9)


# ---- The FMUs; what runs in the child is a function of its own ----


def _run(path, signals):
    with slave(path) as controller:
        controller.initialize(signals.u_m0)
        return controller.get(), controller.run(signals.rows)


def test_torques_are_the_laws_to_the_last_bit(fmu):
    signals = random_signals()
    before, torques = in_child(_run, fmu, signals)
    assert before == signals.u_m0
    assert torques == law(signals)


def _run_interrupted(path, signals, saved_at, serialized):
    """Return the torques after ``saved_at``: gone through at once, then again from the state saved there."""
    with slave(path) as controller:
        controller.initialize(signals.u_m0)
        controller.run(signals.rows[:saved_at])
        state = controller.fmu.getFMUstate()
        if serialized:
            kept = controller.fmu.serializeFMUstate(state)
            controller.fmu.freeFMUstate(state)
        first = controller.run(signals.rows[saved_at:], saved_at)
        if serialized:
            state = controller.fmu.deSerializeFMUstate(kept)
        controller.fmu.setFMUstate(state)
        output = controller.get()
        again = controller.run(signals.rows[saved_at:], saved_at)
        controller.fmu.freeFMUstate(state)
    return first, output, again


@pytest.mark.parametrize("serialized", [False, True], ids=["state", "serialized"])
def test_restored_state_continues_identically(fmu, serialized):
    signals = random_signals(samples=60)
    expected = law(signals)
    first, output, again = in_child(_run_interrupted, fmu, signals, 25, serialized)
    assert first == again == expected[25:]
    assert output == expected[24]


def _restore_into_another(path, signals, saved_at):
    with slave(path) as one:
        one.initialize(signals.u_m0)
        one.run(signals.rows[:saved_at])
        kept = one.fmu.serializeFMUstate(one.fmu.getFMUstate())
    with slave(path) as other:
        other.initialize()
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(kept))
        return other.run(signals.rows[saved_at:], saved_at)


def test_serialized_state_moves_to_another_instance(fmu):
    signals = random_signals(samples=20)
    assert in_child(_restore_into_another, fmu, signals, 10) == law(signals)[10:]


def _reset_and_run(path, signals):
    with slave(path) as controller:
        controller.initialize((9.0, 9.0))
        controller.run(signals.rows)
        controller.fmu.reset()
        controller.initialize(signals.u_m0)
        return controller.run(signals.rows)


def test_reset_forgets_everything(fmu):
    signals = random_signals(samples=20)
    assert in_child(_reset_and_run, fmu, signals) == law(signals)


def _failures(path, steps, parameters):
    """Return the functions that failed, the torques after wrong steps, and the log of everything."""
    failed = []
    with slave(path) as controller:
        controller.initialize()
        for step in steps:
            try:
                controller.fmu.doStep(0.0, step)
            except FMICallException as error:
                failed.append(error.function)
        unchanged = controller.get()
        log = controller.log
    for name, value in parameters:
        with slave(path) as controller:
            controller.set([name], [value])
            try:
                controller.initialize()
            except FMICallException as error:
                failed.append(error.function)
            log += controller.log
    return failed, unchanged, "\n".join(log)


def test_wrong_steps_and_parameters_are_refused_with_a_reason(fmu):
    steps = (2 * T_S, T_S * (1 + 1e-8), 0.0, float("nan"))
    parameters = (("T_s", 0.0), ("T_s", float("inf")), ("z_p[2]", 1.0), ("z_p[1]", float("nan")))
    failed, unchanged, log = in_child(_failures, fmu, steps, parameters)
    assert failed == ["fmi2DoStep"] * len(steps) + ["fmi2ExitInitializationMode"] * len(parameters)
    assert unchanged == (0.0, 0.0)
    assert log.count("the communication step must equal the sample time T_s = 0.00025") == len(steps)
    assert log.count("parameter T_s = ") == 2
    assert "parameter z_p[2] = 1" in log
    assert "parameter z_p[1] = nan" in log


def _values(path, names):
    with slave(path) as controller:
        started = controller.get(names)
        controller.fmu.setupExperiment(startTime=0.0)
        controller.fmu.enterInitializationMode()
        controller.set(("u_m0[1]", "u_m0[2]"), (3.0, 4.0))
        return started, controller.get()


def test_start_values_are_the_described_ones(fmu):
    described = [v for v in read_model_description(str(fmu)).modelVariables if v.start is not None]
    started, output = in_child(_values, fmu, [v.name for v in described])
    assert list(started) == [float(v.start) for v in described]
    assert output == (3.0, 4.0), "outputs follow u_m0 during initialization"
    start = {v.name: float(v.start) for v in described}
    assert all(start[f"{name}[{i + 1}]"] == values[i] for name, values in GAINS.items() for i in range(2))


def test_both_fmus_have_the_same_interface(folder):
    if build_fmus.find_compiler() is None:
        pytest.skip("no C compiler")
    interfaces = [
        [
            (
                v.name,
                v.valueReference,
                v.causality,
                v.variability,
                v.unit,
                v.start and float(v.start),
                v.description,
            )
            for v in read_model_description(str(build_fmus.build(name, folder))).modelVariables
        ]
        for name in FMUS
    ]
    assert interfaces[0] == interfaces[1]
    assert [v[0] for v in interfaces[0] if v[2] == "output"] == list(OUTPUTS)
