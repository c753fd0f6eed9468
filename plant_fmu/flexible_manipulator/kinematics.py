"""Position of the tool centre point (9) and the velocity Jacobian (10)-(11). Angles in rad, lengths in m."""

from __future__ import annotations

from .elementary import sin_cos
from .jit import compiled


@compiled
def tcp(arm, q_a1, q_a2):
    """TCP position ``(x, z)`` [m], eq. (9)."""
    s_1, c_1 = sin_cos(q_a1)
    s_12, c_12 = sin_cos(q_a1 + q_a2)
    return arm.l_1 * s_1 + arm.l_2 * c_12, arm.l_1 * c_1 - arm.l_2 * s_12


@compiled
def tool_torque(arm, s_1, c_1, s_12, c_12, F_x, F_z):
    """Joint torques ``u_a = J(q_a)^T F`` [N.m] of the tool force ``(F_x, F_z)`` [N], eq. (10)-(11).

    ``s_1, c_1`` are sine and cosine of q_a1, ``s_12, c_12`` those of q_a1 + q_a2.
    """
    elbow_x, elbow_z = -arm.l_2 * s_12, -arm.l_2 * c_12
    u_a2 = elbow_x * F_x + elbow_z * F_z
    u_a1 = arm.l_1 * (c_1 * F_x - s_1 * F_z) + u_a2
    return u_a1, u_a2
