"""The steady state that every simulation starts in."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.manipulators import CORNERS, T_S, at_rest, constants, table, tcp_distance, uncertain_tables, workspace

from plant_fmu.flexible_manipulator import dynamics, equilibrium, integrator

EPS = float(np.finfo(float).eps)


@given(values=uncertain_tables(), q_a=workspace)
def test_steady_state_has_no_acceleration(values, q_a):
    arm, joints = constants(values)
    rest = equilibrium.solve(arm, joints, q_a)
    x = (*q_a, *rest.q_m, 0.0, 0.0, 0.0, 0.0)
    tau = [values[f"gamma[{axis}]"] * rest.u_m[axis - 1] for axis in (1, 2)]
    a = np.abs(dynamics.accelerations(arm, *joints, x, *tau, 0.0, 0.0))
    # Angles are known to their rounding, which the spring turns into a torque; gravity is rounded as well.
    stiffest = max(values[f"k_{end}[{axis}]"] for end in ("low", "high") for axis in (1, 2))
    torque = 4 * EPS * (stiffest * max(math.pi, *map(abs, q_a)) + arm.c_1 + arm.c_2)
    J_11, J_12, J_22 = dynamics.inertia(arm, math.sin(q_a[1]))
    lightest = np.linalg.eigvalsh([[J_11, J_12], [J_12, J_22]])[0]
    assert max(a[:2]) <= 2 * torque / lightest
    assert max(a[2:]) <= torque / 200.0 / 0.001


small = st.sampled_from((0.0, 1e-300, 1e-12, -1e-12))


@given(values=uncertain_tables(), axis=st.sampled_from((1, 2)), torque=st.floats(-3000.0, 3000.0) | small)
def test_deflection_inverts_the_spring(values, axis, torque):
    joint = constants(values)[1][axis - 1]
    delta = equilibrium.deflection(joint, torque)
    assert equilibrium.deflection(joint, -torque) == -delta
    # The nearest number to the exact deflection is off by half its last place, the torque by that times the slope.
    slope = max(values[f"k_low[{axis}]"], values[f"k_high[{axis}]"])
    blur = 2 * slope * math.ulp(delta) + 2 * math.ulp(joint.m_0)
    assert dynamics.spring(joint, delta) == pytest.approx(torque, rel=8 * EPS, abs=blur)


def test_start_torque_is_the_one_to_command():
    """Straight out along x the arm hangs with all its weight on the joints; gamma divides what is commanded."""
    values = {**table(), "gamma[1]": 0.9, "gamma[2]": 1.1}
    arm, joints = constants(values)
    rest = equilibrium.solve(arm, joints, (math.pi / 2, -math.pi / 2))
    on_joint_2 = 9.81 * 150 * 0.8
    on_joint_1 = 9.81 * (50 * 0.5 + 150 * 1.0) + on_joint_2
    # The drives push against gravity: at positive angles the links fall towards larger angles.
    assert rest.u_m == pytest.approx((-on_joint_1 / 200 / 0.9, -on_joint_2 / 200 / 1.1), rel=1e-14)
    # The gear gives way to gravity: each link hangs further down than its motor.
    assert rest.q_m[0] / 200 < math.pi / 2 and rest.q_m[1] / 200 < -math.pi / 2


@settings(max_examples=25)
@given(values=uncertain_tables(), q_a=workspace | st.sampled_from(CORNERS))
def test_it_stays_at_rest(values, q_a):
    """With the published torque held, the tool stays within a nanometre for two seconds."""
    memory = at_rest(values, q_a)
    X_0 = memory[10:12].copy()
    farthest = 0.0
    for _ in range(8000):
        integrator.advance(memory, T_S)
        farthest = max(farthest, tcp_distance(memory, X_0))
    assert farthest < 1e-9
