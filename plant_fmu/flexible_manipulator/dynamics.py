"""The equations of motion (2)-(8), term by term, and the accelerations that follow from them.

Angles in rad, speeds in rad/s, torques in N.m. Motor quantities are on the motor's side of the gear.
"""

from __future__ import annotations

import math

from .elementary import exp, sin_cos
from .formulas import EXP_MIN
from .jit import compiled
from .kinematics import tool_torque


@compiled
def inertia(arm, s_2):
    """Inertia matrix of the links ``(J_11, J_12, J_22)`` [kg.m2], eq. (3b)-(3d); ``s_2`` = sin q_a2."""
    coupling = arm.b * s_2
    return arm.a_1 - 2.0 * coupling, arm.a_2 - coupling, arm.a_2


@compiled
def coriolis(arm, c_2, w_1, w_2):
    """Coriolis and centripetal torques ``(C_1, C_2)``, eq. (3h); ``c_2`` = cos q_a2, w the link speeds."""
    coupling = arm.b * c_2
    return -coupling * (2.0 * w_1 + w_2) * w_2, coupling * w_1 * w_1


@compiled
def gravity(arm, s_1, c_12):
    """Gravity torques ``(g_1, g_2)``, eq. (3f)-(3g); ``s_1`` = sin q_a1, ``c_12`` = cos(q_a1 + q_a2)."""
    g_2 = -arm.c_2 * c_12
    return g_2 - arm.c_1 * s_1, g_2


@compiled
def spring(joint, delta):
    """Gear torque tau_s(delta) on the link's side, eq. (5): cubic up to psi, then linear; odd in delta."""
    size = abs(delta)
    if size <= joint.psi:
        return (joint.k_1 + joint.k_3 * delta * delta) * delta
    return math.copysign(joint.m_0 + joint.m_1 * (size - joint.psi), delta)


@compiled
def friction(joint, v):
    """Motor friction torque f / n at motor speed v, eq. (8) with sech for the scan's cosh^-1.

    Both hyperbolic functions are written with exponentials of non-positive arguments, which do not overflow, over one
    common denominator. Below EXP_MIN the exponentials do not count.
    """
    size = abs(v)
    slow = exp(max(-joint.beta * size, EXP_MIN))
    fast = exp(max(-2.0 * joint.alpha * size, EXP_MIN))
    square = 1.0 + slow * slow
    coulomb = (joint.f_k * square + joint.f_s * slow) * (1.0 - fast) / (square * (1.0 + fast))
    return joint.f_d * v + math.copysign(coulomb, v)


@compiled
def accelerations(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z):
    """Accelerations ``(link 1, link 2, motor 1, motor 2)`` [rad/s2], eq. (2) solved for the second derivatives.

    ``x`` = (q_a1, q_a2, q_m1, q_m2 and their speeds); ``tau`` = gamma u_m + u_d, the motors' torques;
    ``F_x, F_z`` the tool force [N].
    """
    q_a1, q_a2, q_m1, q_m2, w_1, w_2, v_1, v_2 = x
    s_1, c_1 = sin_cos(q_a1)
    s_2, c_2 = sin_cos(q_a2)
    s_12, c_12 = s_1 * c_2 + c_1 * s_2, c_1 * c_2 - s_1 * s_2

    gear_1 = spring(joint_1, q_a1 - q_m1 * joint_1.per_n) + joint_1.d * (w_1 - v_1 * joint_1.per_n)
    gear_2 = spring(joint_2, q_a2 - q_m2 * joint_2.per_n) + joint_2.d * (w_2 - v_2 * joint_2.per_n)

    J_11, J_12, J_22 = inertia(arm, s_2)
    C_1, C_2 = coriolis(arm, c_2, w_1, w_2)
    g_1, g_2 = gravity(arm, s_1, c_12)
    u_a1, u_a2 = tool_torque(arm, s_1, c_1, s_12, c_12, F_x, F_z)
    r_1 = u_a1 - C_1 - g_1 - gear_1
    r_2 = u_a2 - C_2 - g_2 - gear_2
    coupling = arm.b * s_2
    per_det = 1.0 / (arm.det - coupling * coupling)

    return (
        (J_22 * r_1 - J_12 * r_2) * per_det,
        (J_11 * r_2 - J_12 * r_1) * per_det,
        (tau_1 + gear_1 * joint_1.per_n - friction(joint_1, v_1)) * joint_1.per_j_m,
        (tau_2 + gear_2 * joint_2.per_n - friction(joint_2, v_2)) * joint_2.per_j_m,
    )
