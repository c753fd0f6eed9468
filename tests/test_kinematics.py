"""Position of the tool centre point and the torques of a tool force."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.manipulators import constants, table, workspace

from plant_fmu.flexible_manipulator import kinematics

ARM, _ = constants(table())
EPS = 2.2e-16
forces = st.floats(-500.0, 500.0)


def tool_torque(q, F):
    s_1, c_1 = math.sin(q[0]), math.cos(q[0])
    s_12, c_12 = math.sin(q[0] + q[1]), math.cos(q[0] + q[1])
    return kinematics.tool_torque(ARM, s_1, c_1, s_12, c_12, *F)


@pytest.mark.parametrize(
    ("q_deg", "tool"),
    [
        ((0, 0), (1.5, 1.0)),  # Figure 2: link 1 up, link 2 along x
        ((0, -90), (0.0, 2.5)),  # stretched out, straight up
        ((90, -90), (2.5, 0.0)),  # stretched out along x
        ((0, 90), (0.0, -0.5)),  # folded back over link 1
        ((-90, 0), (-1.0, 1.5)),
        ((180, -180), (1.5, -1.0)),
    ],
)
def test_tool_position_in_poses_drawn_by_hand(q_deg, tool):
    q = [math.radians(angle) for angle in q_deg]
    assert kinematics.tcp(ARM, *q) == pytest.approx(tool, abs=10 * EPS)


@given(q=workspace)
def test_law_of_cosines(q):
    """Shoulder, elbow and tool make a triangle whose angle at the elbow turns with q_a2 alone."""
    x, z = kinematics.tcp(ARM, *q)
    squared = 1.0**2 + 1.5**2 - 2 * 1.0 * 1.5 * math.cos(math.pi / 2 - q[1])
    assert x * x + z * z == pytest.approx(squared, abs=50 * EPS)


@given(q=workspace, F=st.tuples(forces, forces), axis=st.sampled_from((0, 1)))
def test_virtual_work(q, F, axis):
    """A joint torque does the work that the force does at the tool: u_a . dq = F . dX for each joint."""
    step = 1e-5
    moved = [kinematics.tcp(ARM, *(angle + sign * step * (i == axis) for i, angle in enumerate(q))) for sign in (-1, 1)]
    work = sum(force * (after - before) for force, before, after in zip(F, *moved, strict=True)) / (2 * step)
    # Central differences: truncation step^2 / 6 and rounding EPS / step are 2e-11 each, times reach and force.
    assert tool_torque(q, F)[axis] == pytest.approx(work, abs=5e-11 * 2.5 * (abs(F[0]) + abs(F[1])) + 1e-300)
