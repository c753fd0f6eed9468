"""The steady state in which every simulation starts: links at rest at q_a, gears bent by gravity alone."""

from __future__ import annotations

import math
from typing import NamedTuple

from .coefficients import Arm, Joint
from .dynamics import gravity, spring
from .formulas import sin_cos


class Equilibrium(NamedTuple):
    """Motor angles ``q_m`` [rad] and torques ``u_m`` [N.m] (the ones to command, gamma included) at rest."""

    q_m: tuple[float, float]
    u_m: tuple[float, float]


def deflection(joint: Joint, torque: float) -> float:
    """The deflection [rad] at which the gear of eq. (5) carries ``torque`` [N.m], to the last bit but one.

    Beyond the breakpoint the law is linear. Before it the cubic rises monotonically from slope k_low to
    slope k_high (both positive, in either order), so bisection ends at neighbouring floating-point numbers.
    """
    load = abs(torque)
    if load > joint.m_0:
        return math.copysign(joint.psi + (load - joint.m_0) / joint.m_1, torque)
    low, high = 0.0, joint.psi
    while low < (middle := 0.5 * (low + high)) < high:
        low, high = (middle, high) if spring(joint, middle) < load else (low, middle)
    return math.copysign(high, torque)


def solve(arm: Arm, joints: tuple[Joint, Joint], q_a: tuple[float, float]) -> Equilibrium:
    """Steady state of eq. (2) at link angles ``q_a`` [rad] without tool force and disturbance.

    The gear balances gravity, tau_s(Delta) = -g(q_a) by the link rows of (2), and the motor carries the gear,
    n gamma u_m = g(q_a) by the motor rows. Friction is zero at rest, since tanh(0) = 0 in (8).
    """
    loads = gravity(arm, sin_cos(q_a[0])[0], sin_cos(q_a[0] + q_a[1])[1])
    axes = tuple(zip(joints, q_a, loads, strict=True))
    q_m_1, q_m_2 = ((angle - deflection(joint, -load)) / joint.per_n for joint, angle, load in axes)
    u_m_1, u_m_2 = (load * joint.per_n / joint.gamma for joint, _, load in axes)
    return Equilibrium((q_m_1, q_m_2), (u_m_1, u_m_2))
