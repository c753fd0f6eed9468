"""The controllers beyond the paper's: the design's steps, and the dither."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from numpy.testing import assert_allclose
from scipy import linalg
from support.manipulators import CORNERS, constants, table, uncertain_tables, workspace
from support.pid_fmus import T_S
from test_pid import STARTS

from controller_fmu.friction import flexible_manipulator_dither as shaking
from controller_fmu.lqg.flexible_manipulator_lqg import design as lqg
from controller_fmu.lqg.flexible_manipulator_lqg.interface import Weights, chosen
from plant_fmu.flexible_manipulator import equilibrium, kinematics
from plant_fmu.flexible_manipulator.dynamics import accelerations, spring

WEIGHTS = chosen(Weights, STARTS["ManipulatorLQG"])
POSES = [*CORNERS, (0.4, -1.1), (1.2, -2.6)]


# --- the design's steps ---


@given(workspace)
def test_pose_is_recovered_from_the_steady_state(q_a):
    arm, joints = constants(table())
    rest = equilibrium.solve(arm, joints, q_a)
    found = lqg.pose(rest.q_m, rest.u_m)
    assert_allclose(found.q_a, q_a, rtol=0, atol=1e-12)
    for i, joint in enumerate(joints):
        delta = q_a[i] - rest.q_m[i] * joint.per_n
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
    rest = (*q_a, *(angle / joint.per_n for joint, angle in zip(joints, q_a, strict=True)), 0.0, 0.0, 0.0, 0.0)

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
def test_jacobian_and_discretization_at_a_pose(q_a):
    arm, _ = constants(table())
    for column in range(2):
        change = 1e-6 * np.eye(2)[column]
        slope = np.subtract(kinematics.tcp(arm, *(q_a + change)), kinematics.tcp(arm, *(q_a - change))) / 2e-6
        assert_allclose(lqg.tool_jacobian(q_a)[:, column], slope, atol=1e-8)
    A, B = lqg.linearize(WEIGHTS, lqg.Pose(q_a, lqg.K_HIGH))
    expected = linalg.expm(np.block([[A, B], [np.zeros((4, 12))]]) * T_S)[:8]
    for found, block in zip(lqg.discretize(A, B, T_S), (expected[:, :8], expected[:, 8:]), strict=True):
        assert_allclose(found, block, rtol=1e-10, atol=1e-12 * abs(block).max())


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


# --- the dither ---


def test_dither_follows_the_level():
    constants = shaking.Wave((4.0, 2.0), 8.0, 1e-4, 3e-4, 0.5)
    assert shaking.dither(constants, 0.0, 0.9e-4, 2) == (0.9e-4, 0.0, 0.0)
    assert shaking.dither(constants, 0.0, 3e-4, 2) == (3e-4, 4.0, 2.0)
    level, *torques = shaking.dither(constants, 4e-4, 0.0, 2)
    assert level == 2e-4
    assert torques == pytest.approx([2.0, 1.0])


def test_dither_has_no_mean():
    constants = shaking.wave(chosen(shaking.Dither, STARTS["DitheredLQG"]), T_S)
    waves = [shaking.dither(constants, 1.0, 1.0, k)[1:] for k in range(int(constants.period))]
    assert constants.period == len(waves) == 16
    assert_allclose(np.sum(waves, axis=0), 0.0, atol=1e-12)
