"""Integration over one communication step: classical Runge-Kutta of fourth order with fixed substeps."""

from __future__ import annotations

import math

import numpy as np

from .coefficients import Arm, Joint
from .dynamics import accelerations
from .jit import compiled
from .kinematics import tcp

MAX_SUBSTEP = 0.25e-3 / 3
"""Longest substep [s]: three in the benchmark's sample time keep the TCP within 1e-8 m of an adaptive solution of
eighth order over the whole uncertainty of Table 1 (tests/test_integrator.py)."""

MAX_STIFFNESS = 1.25
"""Largest product of substep and fastest rate, h lambda. Runge-Kutta's fourth order is stable up to 2.78; the
stiffest system of Table 1 has 1.125 at MAX_SUBSTEP, and steeper friction than that gets shorter substeps."""


def longest_substep(joints: tuple[Joint, Joint]) -> float:
    """Longest substep [s] for these joints: the fastest rate of the system is that of a motor whose friction (8)
    is linearised at zero speed, (alpha f_c + f_d) / j_m."""
    rate = max((joint.alpha * joint.f_c + joint.f_d) / joint.j_m for joint in joints)
    return min(MAX_SUBSTEP, MAX_STIFFNESS / rate) if rate > 0 else MAX_SUBSTEP


def memory(q_a: tuple[float, float], q_m: tuple[float, float], arm: Arm, joints: tuple[Joint, Joint]) -> np.ndarray:
    """Everything :func:`advance` works on, as one float64 array of shape (44,): an array crosses into machine
    code at the price of one argument. State at rest at link angles ``q_a`` and motor angles ``q_m`` [rad]."""
    state = (*q_a, *q_m, 0.0, 0.0, 0.0, 0.0)
    return np.array([*state, longest_substep(joints), *arm, *joints[0], *joints[1]], dtype=np.float64)


@compiled
def unpack(memory):
    """The constants in :func:`memory`: ``(Arm, Joint 1, Joint 2)``."""
    c = memory[9:]
    return (
        Arm(c[0], c[1], c[2], c[3], c[4], c[5], c[6]),
        Joint(c[7], c[8], c[9], c[10], c[11], c[12], c[13], c[14], c[15], c[16], c[17], c[18], c[19], c[20]),
        Joint(c[21], c[22], c[23], c[24], c[25], c[26], c[27], c[28], c[29], c[30], c[31], c[32], c[33], c[34]),
    )


@compiled
def derivative(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z):
    """Time derivative of the state ``x``, see :func:`advance`."""
    a = accelerations(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z)
    return (x[4], x[5], x[6], x[7], a[0], a[1], a[2], a[3])


@compiled
def along(x, h, dx):
    """``x + h dx`` for tuples of eight floats."""
    return (
        x[0] + h * dx[0],
        x[1] + h * dx[1],
        x[2] + h * dx[2],
        x[3] + h * dx[3],
        x[4] + h * dx[4],
        x[5] + h * dx[5],
        x[6] + h * dx[6],
        x[7] + h * dx[7],
    )


@compiled
def advance(memory, u_m1, u_m2, u_d1, u_d2, F_x, F_z, step):
    """Advance the state in ``memory`` in place by ``step`` [s] >= 0 with the inputs held.

    The first eight entries of ``memory`` are the state: link angles, motor angles [rad], link speeds, motor
    speeds [rad/s]. Returns the outputs at the end of the step, ``(q_m1, q_m2, q_a1, q_a2, X_x, X_z)`` [rad, m].
    """
    arm, joint_1, joint_2 = unpack(memory)
    tau_1 = joint_1.gamma * u_m1 + u_d1
    tau_2 = joint_2.gamma * u_m2 + u_d2
    x = (memory[0], memory[1], memory[2], memory[3], memory[4], memory[5], memory[6], memory[7])
    # A step of three substeps must not become one of four because its size was rounded up.
    substeps = math.ceil(step / memory[8] * (1.0 - 1e-9))
    h = step / max(substeps, 1)
    for _ in range(substeps):
        k_1 = derivative(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z)
        k_2 = derivative(arm, joint_1, joint_2, along(x, 0.5 * h, k_1), tau_1, tau_2, F_x, F_z)
        k_3 = derivative(arm, joint_1, joint_2, along(x, 0.5 * h, k_2), tau_1, tau_2, F_x, F_z)
        k_4 = derivative(arm, joint_1, joint_2, along(x, h, k_3), tau_1, tau_2, F_x, F_z)
        slope = along(along(along(k_1, 2.0, k_2), 2.0, k_3), 1.0, k_4)
        x = along(x, h / 6.0, slope)
    memory[0], memory[1], memory[2], memory[3] = x[0], x[1], x[2], x[3]
    memory[4], memory[5], memory[6], memory[7] = x[4], x[5], x[6], x[7]
    X_x, X_z = tcp(arm, x[0], x[1])
    return x[2], x[3], x[0], x[1], X_x, X_z
