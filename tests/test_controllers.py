"""The controllers beyond the paper's: the design's steps, the laws, their FMUs, and the simulator that tuned them."""

from __future__ import annotations

import hashlib
import itertools
import json
from pathlib import Path

import numpy as np
import pytest
from fmpy import read_model_description, simulate_fmu
from hypothesis import given, settings
from manipulators import CORNERS, constants, table, uncertain_tables, workspace
from numpy.testing import assert_allclose
from pid_fmus import INPUTS, T_S, Signals, in_child, random_signals, slave
from scipy import linalg

import build_fmus
from controller_fmu.friction import flexible_manipulator_dither as shaking
from controller_fmu.friction import tune as friction
from controller_fmu.lqg import flexible_manipulator_lqg as lqg
from controller_fmu.lqg import tune as plain
from controller_fmu.pid_tuned import tune as pid
from controller_fmu.tuning import problem, stability
from plant_fmu.flexible_manipulator import equilibrium, kinematics
from plant_fmu.flexible_manipulator.dynamics import accelerations, spring

WEIGHTS = lqg.read_weights(plain.WEIGHTS)
POSES = [*CORNERS, (0.4, -1.1), (1.2, -2.6)]
NAMES = ("TunedPID", "ManipulatorLQG", "DitheredLQG")
U_M0 = (1.7, -0.3)
AT = (60.0, -180.0)
"""Motor angles of a pose in the workspace [rad]."""


@pytest.fixture(scope="module", params=NAMES)
def fmu(request, fmu_folder):
    return build_fmus.build(request.param, fmu_folder)


def near_rest(samples: int, size: float, seed: int = 3) -> Signals:
    """Measurements scattered by ``size`` [rad] about the reference AT."""
    scatter = size * np.random.default_rng(seed).normal(size=(samples, 2))
    return Signals(np.tile(AT, (samples, 1)), np.array(AT) + scatter, U_M0)


# --- the design's steps ---


@given(workspace)
def test_pose_is_recovered_from_the_steady_state(q_a):
    arm, joints = constants(table())
    rest = equilibrium.solve(arm, joints, q_a)
    found = lqg.pose(rest.q_m, rest.u_m)
    assert_allclose(found.q_a, q_a, rtol=0, atol=1e-12)
    for i, joint in enumerate(joints):
        delta = q_a[i] - rest.q_m[i] / joint.n
        slope = (spring(joint, delta + 1e-9) - spring(joint, delta - 1e-9)) / 2e-9
        assert found.slope[i] == pytest.approx(slope, rel=1e-5)


@given(uncertain_tables(swapped_stiffness=False), workspace)
@settings(max_examples=50)
def test_pose_of_an_uncertain_manipulator_is_found_to_milliradians(values, q_a):
    rest = equilibrium.solve(*constants(values), q_a)
    assert_allclose(lqg.pose(rest.q_m, rest.u_m).q_a, q_a, rtol=0, atol=1.5e-3)


@pytest.mark.parametrize("q_a", POSES)
def test_model_is_the_linearized_manipulator(q_a):
    values = {**table(f_c=0.0), "g": 0.0}
    arm, joints = constants(values)
    rest = (*q_a, *(joint.n * angle for joint, angle in zip(joints, q_a, strict=True)), 0.0, 0.0, 0.0, 0.0)

    def acceleration(x, tau):
        return np.array(accelerations(arm, *joints, tuple(x), *tau, 0.0, 0.0))

    friction_0 = (joints[0].f_d, joints[1].f_d)
    bare = WEIGHTS._replace(stiffness=(1.0, 1.0), hardening=1.0, friction=friction_0)
    A, B = lqg.linearize(bare, lqg.pose((rest[2], rest[3]), (0.0, 0.0)))
    step = 1e-6
    for column in range(8):
        change = step * np.eye(8)[column]
        slope = (acceleration(rest + change, (0, 0)) - acceleration(rest - change, (0, 0))) / (2 * step)
        assert_allclose(A[4:, column], slope, rtol=1e-6, atol=1e-6 * abs(A[4:]).max())
    for column in range(2):
        assert_allclose(B[4:, column], acceleration(rest, np.eye(2)[column]), rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("q_a", POSES)
def test_tool_jacobian_is_the_derivative_of_the_kinematics(q_a):
    arm, _ = constants(table())
    for column in range(2):
        change = 1e-6 * np.eye(2)[column]
        slope = np.subtract(kinematics.tcp(arm, *(q_a + change)), kinematics.tcp(arm, *(q_a - change))) / 2e-6
        assert_allclose(lqg.tool_jacobian(q_a)[:, column], slope, atol=1e-8)


@pytest.mark.parametrize("q_a", POSES)
def test_discretization_is_the_matrix_exponential(q_a):
    A, B = lqg.linearize(WEIGHTS, lqg.Pose(q_a, lqg.K_HIGH))
    A_d, B_d = lqg.discretize(A, B, T_S)
    expected = linalg.expm(np.block([[A, B], [np.zeros((4, 12))]]) * T_S)
    assert_allclose(A_d, expected[:8, :8], rtol=1e-10, atol=1e-12 * abs(expected).max())
    assert_allclose(B_d, expected[:8, 8:], rtol=1e-10, atol=1e-12 * abs(expected[:8, 8:]).max())


@pytest.mark.parametrize("seed", range(5))
def test_riccati_equation_is_solved(seed):
    random = np.random.default_rng(seed)
    A, B = random.normal(size=(6, 6)), random.normal(size=(6, 2))
    root = random.normal(size=(6, 3))
    Q, R = root @ root.T, np.diag([0.1, 2.0])
    assert_allclose(lqg.riccati(A, B, Q, R), linalg.solve_discrete_are(A, B, Q, R), rtol=1e-8, atol=1e-8)


def test_riccati_equation_without_solution_is_refused():
    with pytest.raises(ValueError, match="no stabilizing solution"):
        lqg.riccati(np.array([[2.0]]), np.array([[0.0]]), np.eye(1), np.eye(1))


@pytest.mark.parametrize(
    ("law_of", "name"),
    [
        (plain.law_of(WEIGHTS), "lqg"),
        (plain.law_of(lqg.read_weights(friction.WEIGHTS)), "friction"),
        (pid.law_of(json.loads(pid.GAINS.read_text())["gains"]), "pid_tuned"),
    ],
)
def test_linear_loop_is_stable_over_poses_and_frictions_never_tuned_for(law_of, name):
    frictions = list(itertools.product((0.001, 0.1, 0.3, 1.0, 3.0, 8.0, 20.0), (0.001, 0.1, 0.3, 1.0, 3.0, 7.0, 14.0)))
    plants = stability.linear_plants(problem.scattered_poses(12, seed=99), frictions)
    assert stability.decay_rates(plants, law_of).min() > 0.0


def test_linear_loop_tells_what_fails_a2():
    """The paper's gains oscillate with more delay on axis 2 when friction is low."""
    paper = pid.law_of({"K_p": (45.0, 15.0), "K_i": (30.0, 10.0), "K_d": (1.5, 0.5), "z_p": (0.95, 0.95)})
    assert stability.decay_rates(stability.linear_plants(problem.PAPER.grid[:1]), paper).min() < -1.0


# --- the dither ---


def test_dither_follows_the_level():
    constants = shaking.Dither(4.0, 2.0, 8.0, 1e-4, 3e-4, 0.5)
    assert shaking.dither(constants, 0.0, 0.9e-4, 2) == (0.9e-4, 0.0, 0.0)
    assert shaking.dither(constants, 0.0, 3e-4, 2) == (3e-4, 4.0, 2.0)
    level, *torques = shaking.dither(constants, 4e-4, 0.0, 2)
    assert level == 2e-4
    assert torques == pytest.approx([2.0, 1.0])


def test_dither_has_no_mean():
    constants = friction.read_dither(friction.WEIGHTS)
    waves = [shaking.dither(constants, 1.0, 1.0, k)[1:] for k in range(int(constants.period))]
    assert_allclose(np.sum(waves, axis=0), 0.0, atol=1e-12)


# --- data files ---


@pytest.mark.parametrize("module", [pid, plain, friction], ids=["pid_tuned", "lqg", "friction"])
def test_data_file_is_what_the_tuning_script_made(module):
    file = getattr(module, "WEIGHTS", None) or module.GAINS
    script = Path(module.__file__)
    tuned = json.loads(file.read_text())["tuned"]
    assert tuned["script"] == script.name
    assert tuned["sha256"] == hashlib.sha256(script.read_bytes()).hexdigest()


# --- the FMUs ---


def torques_of(path: Path, signals: Signals) -> list[tuple[float, ...]]:
    with slave(path) as controller:
        start(controller, signals)
        return controller.run(signals.rows)


def start(controller, signals: Signals) -> None:
    controller.fmu.setupExperiment(startTime=0.0)
    controller.set(("u_m0[1]", "u_m0[2]"), signals.u_m0)
    controller.fmu.enterInitializationMode()
    controller.set(INPUTS, (*signals.q_m_ref[0], *signals.q_m_ref[0]))
    controller.fmu.exitInitializationMode()


def recursion(signals: Signals, weights_file: Path, constants: shaking.Dither | None) -> np.ndarray:
    """Torques [N.m] of the design in ``weights_file``, as plainly as can be."""
    design = lqg.controller(lqg.read_weights(weights_file), lqg.pose(AT, U_M0), T_S)
    z, u, level, torques = np.zeros(12), np.zeros(2), 0.0, []
    for k, (reference, measured) in enumerate(zip(signals.q_m_ref, signals.q_m, strict=True)):
        z = design.step @ np.concatenate([z, u, measured - reference])
        u = -design.gain @ z
        if constants:
            level, *shake = shaking.dither(constants, level, float(np.linalg.norm(design.tool @ z)), k)
            u = np.clip(np.add(U_M0, u) + shake, [-35.0, -20.0], [35.0, 20.0]) - U_M0
        torques.append(np.add(U_M0, u))
    return np.array(torques)


@pytest.mark.parametrize("size", [1e-4, 0.03], ids=["small", "into the limits"])
def test_lqg_fmus_follow_their_laws(size, fmu_folder):
    signals = near_rest(400, size)
    for name, file, shake in (
        ("ManipulatorLQG", plain.WEIGHTS, None),
        ("DitheredLQG", friction.WEIGHTS, friction.read_dither(friction.WEIGHTS)),
    ):
        expected = recursion(signals, file, shake)
        found = in_child(torques_of, build_fmus.build(name, fmu_folder), signals)
        assert_allclose(found, expected, rtol=1e-7, atol=1e-7)


def test_tuned_pid_is_the_pid_with_other_gains(fmu_folder):
    gains = json.loads(pid.GAINS.read_text())["gains"]
    file = build_fmus.build("TunedPID", fmu_folder)
    starts = {variable.name: variable.start for variable in read_model_description(str(file)).modelVariables}
    for (name, pair), i in itertools.product(gains.items(), (0, 1)):
        assert float(starts[f"{name}[{i + 1}]"]) == pair[i]
    signals = random_signals(100)
    matrix = pid.law_of(gains)((0.0, 0.0), signals.u_m0).matrix
    z, expected = np.zeros(10), []
    for e in signals.q_m - signals.q_m_ref:
        z = matrix @ np.concatenate([z[:8], e])
        expected.append(z[6:8] + signals.u_m0)
    assert_allclose(in_child(torques_of, file, signals), expected, rtol=1e-9)


def alone(path: Path) -> np.ndarray:
    return simulate_fmu(str(path), stop_time=0.05, output_interval=T_S, start_values={"u_m0[1]": 1.5})["u_m[1]"]


def test_fmu_runs_alone_in_fmpy(fmu):
    assert_allclose(in_child(alone, fmu), 1.5, atol=0.5)


def saved_and_restored(path: Path, signals: Signals) -> tuple[list[tuple[float, ...]], list[tuple[float, ...]]]:
    with slave(path) as controller:
        start(controller, signals)
        controller.run(signals.rows[:40])
        state = controller.fmu.getFMUstate()
        bytes_of_it = controller.fmu.serializeFMUstate(state)
        first = controller.run(signals.rows[40:], first=40)
        controller.fmu.setFMUstate(controller.fmu.deSerializeFMUstate(bytes_of_it))
        return first, controller.run(signals.rows[40:], first=40)


def test_state_can_be_saved_and_restored(fmu):
    first, second = in_child(saved_and_restored, fmu, near_rest(80, 1e-3))
    assert first == second


def refusals(path: Path) -> list[str]:
    with slave(path) as controller:
        start(controller, near_rest(1, 0.0))
        with pytest.raises(Exception, match="fmi2DoStep"):
            controller.fmu.doStep(0.0, 2 * T_S)
    with slave(path) as other:
        other.fmu.setupExperiment(startTime=0.0)
        other.set(("T_s",), (0.0,))
        other.fmu.enterInitializationMode()
        with pytest.raises(Exception, match="fmi2ExitInitializationMode"):
            other.fmu.exitInitializationMode()
    return [*controller.log, *other.log]


def test_wrong_steps_and_sample_times_are_refused_in_words(fmu):
    text = " ".join(in_child(refusals, fmu))
    assert "must equal the sample time T_s = 0.00025 s" in text
    assert "T_s = 0.0 s: the sample time must be positive" in text
