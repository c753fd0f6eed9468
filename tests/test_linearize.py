"""Linear models of the plant: the derivatives are held against Lagrange's equations in ``test_dynamics.py``."""

import math
from fractions import Fraction

import numpy as np
import pytest
from scipy.io import loadmat
from support.command_lines import call
from support.manipulators import T_S, at_rest
from support.refusals import refusal

from orchestrator import Benchmark, Variation
from plant_fmu.flexible_manipulator import integrator

BENCH = Benchmark(plant_parameters={"k_high[2]": 0.4e6})
POSE = (0.3, -0.9)


def simulated(case, inputs, parts=20):
    """Deviations of (q_m, X) at the samples, by the plant's own step in parts of a sample; what leaves a controller
    at sample k acts ``drive.delay`` later."""
    drive, memory = case.scenario.drive, at_rest(dict(case.scenario.parameters), POSE)
    rest, found = memory[:12].copy(), []
    for k in range(len(inputs)):
        found.append(memory[[6, 7, 10, 11]] - rest[[6, 7, 10, 11]])
        memory[2:6] = inputs[k, 2:]
        for part in range(parts):
            for axis in (0, 1):
                sent = math.floor(k + Fraction(part, parts) - drive.delay[axis] * 4000)
                memory[axis] = rest[axis] + (drive.gain[axis] * inputs[sent, axis] if sent >= 0 else 0.0)
            integrator.advance(memory, T_S / parts)
    return np.array(found)


@pytest.mark.parametrize(
    ("test", "variation"),
    [
        ("disturbance", None),
        ("delay_2", None),
        ("gain_1", Variation(delay=(Fraction(0), Fraction("0.0006")))),  # two samples and two fifths
    ],
)
def test_small_motions_are_those_of_the_plant(test, variation):
    model = BENCH.linearize(POSE, "random_1", test=test, variation=variation)
    case = BENCH.case_at(POSE, "random_1", test, variation)
    inputs = 1e-3 * np.random.default_rng(1).normal(size=(60, 6))
    # Half the difference of a motion and its mirror image: what is left of the nonlinearity is of third order.
    nonlinear = (simulated(case, inputs) - simulated(case, -inputs)) / 2.0
    x, found = np.zeros(len(model.A)), []
    for u in inputs:
        found.append(model.C @ x + model.D @ u)
        x = model.A @ x + model.B @ u
    assert np.all(np.abs(found - nonlinear) <= 1e-4 * np.abs(nonlinear).max(axis=0))


def test_sliding_friction_is_viscous_alone_and_without_delay_there_are_eight_states():
    sliding = BENCH.linearize(POSE, sampled=False, friction="sliding")
    lighter = Benchmark(plant_parameters={**BENCH.plant_parameters, "f_c[1]": 0.0, "f_c[2]": 0.0})
    np.testing.assert_array_equal(lighter.linearize(POSE, sampled=False).A, sliding.A)
    assert sliding.sample_time is None
    sampled = BENCH.linearize(POSE, delay=False, friction="sliding")
    assert sampled.A.shape == (8, 8) and sampled.sample_time == T_S
    np.testing.assert_allclose(sampled.modes, sliding.modes, rtol=1e-5)
    with pytest.raises(ValueError, match="read-only"):
        sampled.A[0, 0] = 1.0


@pytest.mark.needs("control")
def test_models_travel(tmp_path):
    model = BENCH.linearize(POSE)
    npz, mat = np.load(model.save(tmp_path / "model.npz")), loadmat(model.save(tmp_path / "model.mat"))
    for name in "ABCD":
        np.testing.assert_array_equal(npz[name], getattr(model, name))
        np.testing.assert_array_equal(mat[name], getattr(model, name))
    assert tuple(npz["states"]) == model.states == tuple(str(cell[0]) for cell in mat["states"].ravel())
    assert mat["T_s"] == npz["T_s"] == T_S
    np.testing.assert_array_equal(npz["q_m_rest"], model.at.q_m)
    assert "<table" in model._repr_html_() and "nominal" in model._repr_html_()
    import control

    system = model.to_control()
    assert isinstance(system, control.StateSpace) and system.dt == T_S
    assert tuple(system.state_labels) == model.states and tuple(system.input_labels) == model.inputs
    np.testing.assert_array_equal(system.A, model.A)


def test_what_cannot_be_linearized(tmp_path, quick_pid_file):
    late = Variation(sensor_delay=(Fraction(0), Fraction(1, 1000)))
    assert refusal(BENCH.linearize, POSE, variation=late).what == "sensor-delay"
    assert refusal(BENCH.linearize, POSE, friction="dry").nearest == ("sticking", "sliding")
    assert refusal(BENCH.linearize, POSE, "soft").what == "no-system"
    assert refusal(Benchmark(plant=quick_pid_file).linearize, POSE).what == "no-equations"
    assert refusal(BENCH.linearize(POSE).save, tmp_path / "model.txt").what == "bad-ending"


def test_the_command(tmp_path):
    options = "--configuration 45 -60 --system nominal --test delay_2 --plant-set d[1]=500 --output model.npz"
    finished = call("linearize", *options.split(), folder=tmp_path)
    assert finished.code == 0 and "16 states" in finished.out and finished.err == "written to model.npz\n"
    q_a = math.radians(45), math.radians(-60)
    expected = Benchmark(plant_parameters={"d[1]": 500.0}).linearize(q_a, "nominal", test="delay_2")
    np.testing.assert_array_equal(np.load(tmp_path / "model.npz")["A"], expected.A)
