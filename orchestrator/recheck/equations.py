"""The equations of motion, derived from the kinematics of the bodies and not from the matrices of the paper.

Each link is a rigid body whose centre of mass moves with v_i = J_i(q_a) dq_a; d'Alembert's principle in the form of
Kane gives sum_i J_i^T m_i (J_i ddq_a + dJ_i/dt dq_a) + rotation = the generalized forces of gravity, gears and tool.
The links' angles are measured as in eq. (9): link 1 stands at q_a1 from the vertical, link 2 lies at q_a1 + q_a2 below
the horizontal. All quantities in SI units; angles and speeds have arrays of any shape S.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class ArmAxis:
    """The motor, gear and link of one axis, Table 1."""

    j_m: float
    j: float
    m: float
    l: float  # noqa: E741 - the paper's symbol
    xi: float
    n: float
    k_low: float
    k_high: float
    psi: float
    d: float
    f_d: float
    f_c: float
    mu_k: float
    beta: float
    alpha: float
    gamma: float


@dataclass(frozen=True)
class Arm:
    """Both axes, and the acceleration of gravity [m/s^2]."""

    axes: tuple[ArmAxis, ArmAxis]
    g: float


def arm(parameters: Mapping[str, float]) -> Arm:
    """The arm with ``parameters`` by the names of the plant's FMU, such as ``m[1]``."""
    names = ArmAxis.__dataclass_fields__
    one, two = (ArmAxis(**{name: parameters[f"{name}[{axis}]"] for name in names}) for axis in (1, 2))
    return Arm((one, two), parameters["g"])


def tool(arm: Arm, q: Array) -> Array:
    """Position of the tool centre point, eq. (9) [m]: shape (2, S) for link angles of shape (2, S)."""
    l_1, l_2 = (axis.l for axis in arm.axes)
    a, b = q[0], q[0] + q[1]
    return np.stack([l_1 * np.sin(a) + l_2 * np.cos(b), l_1 * np.cos(a) - l_2 * np.sin(b)])


def _jacobian(q: Array, first: float, second: float) -> tuple[Array, Array]:
    """Of the point ``first`` [m] along link 1 and then ``second`` along link 2: its columns, of shape (2, S)."""
    a, b = q[0], q[0] + q[1]
    turned = np.stack([-second * np.sin(b), -second * np.cos(b)])
    return np.stack([first * np.cos(a), -first * np.sin(a)]) + turned, turned


def _drift(q: Array, dq: Array, first: float, second: float) -> Array:
    """Acceleration of that point while the joints' speeds are constant, shape (2, S)."""
    a, b = q[0], q[0] + q[1]
    w_a, w_b = dq[0] ** 2, (dq[0] + dq[1]) ** 2
    return np.stack(
        [-first * np.sin(a) * w_a - second * np.cos(b) * w_b, -first * np.cos(a) * w_a + second * np.sin(b) * w_b]
    )


def spring(axis: ArmAxis, twist: Array) -> Array:
    """Torque of the gear [N.m] at a twist q_a - q_m / n [rad], eq. (5): the integral of its stiffness, which grows with
    the square of the twist from k_low to k_high at psi, and stays there."""
    inner = np.clip(twist, -axis.psi, axis.psi)
    growth = (axis.k_high - axis.k_low) / axis.psi**2
    torque: Array = axis.k_low * inner + growth * inner**3 / 3.0 + axis.k_high * (twist - inner)
    return torque


def friction(axis: ArmAxis, speed: Array) -> Array:
    """Torque [N.m] against a motor's ``speed`` [rad/s], eq. (8) with sech for the misprinted cosh^-1."""
    # cosh overflows a float64 from 710 on.
    falling = 1.0 / np.cosh(np.clip(axis.beta * speed, -700.0, 700.0))
    return axis.f_d * speed + axis.f_c * (axis.mu_k + (1.0 - axis.mu_k) * falling) * np.tanh(axis.alpha * speed)


def rates(arm: Arm, state: Array, u_m: Array, u_d: Array, force: Array) -> Array:
    """Time derivative of the state (q_m, q_a, dq_m, dq_a), shape (8, S), under motor torques ``u_m``, disturbances
    ``u_d`` [N.m] and tool force ``force`` [N], each of shape (2, S)."""
    q_m, q_a, dq_m, dq_a = state[0:2], state[2:4], state[4:6], state[6:8]
    one, two = arm.axes
    bodies = ((one.m, one.xi, 0.0), (two.m, one.l, two.xi))
    mass = [[one.j + two.j, two.j], [two.j, two.j]]
    load = [np.zeros_like(q_a[0]), np.zeros_like(q_a[0])]
    # Kane: each body's inertial force, projected on the speeds of the joints by the columns of its Jacobian.
    for m, first, second in bodies:
        columns, drift = _jacobian(q_a, first, second), _drift(q_a, dq_a, first, second)
        for i in range(2):
            # Gravity pulls along -z.
            load[i] = load[i] - m * (columns[i] * drift).sum(axis=0) - m * arm.g * columns[i][1]
            mass[i] = [mass[i][k] + m * (columns[i] * columns[k]).sum(axis=0) for k in range(2)]
    reach = _jacobian(q_a, one.l, two.l)
    ddq_m = []
    for i, axis in enumerate(arm.axes):
        gear = spring(axis, q_a[i] - q_m[i] / axis.n) + axis.d * (dq_a[i] - dq_m[i] / axis.n)
        load[i] = load[i] - gear + (reach[i] * force).sum(axis=0)
        ddq_m.append((axis.gamma * u_m[i] + u_d[i] - friction(axis, dq_m[i]) + gear / axis.n) / axis.j_m)
    # Two by two, solved by hand: for all segments at once, without a library's factorization.
    determinant = mass[0][0] * mass[1][1] - mass[0][1] * mass[1][0]
    ddq_a = [
        (mass[1][1] * load[0] - mass[0][1] * load[1]) / determinant,
        (mass[0][0] * load[1] - mass[1][0] * load[0]) / determinant,
    ]
    return np.stack([*dq_m, *dq_a, *ddq_m, *ddq_a])


def rest(arm: Arm, q_a: Array) -> tuple[Array, Array]:
    """Motor angles [rad] and torque commands [N.m] that hold the links at ``q_a``, shape (2,) each.

    The gears carry gravity: their twist is found by Newton's method; what they carry, divided by n and gamma, is the
    command.
    """
    one, two = arm.axes
    gravity = np.zeros(2)
    for m, first, second in ((one.m, one.xi, 0.0), (two.m, one.l, two.xi)):
        gravity += [-m * arm.g * column[1] for column in _jacobian(q_a, first, second)]
    q_m, u_m = np.zeros(2), np.zeros(2)
    for i, axis in enumerate(arm.axes):
        twist = np.array(gravity[i] / axis.k_low)
        # The stiffness is never below k_low, so Newton's steps are bounded, and converge within a few rounds.
        for _ in range(100):
            inner = min(abs(float(twist)), axis.psi)
            stiffness = axis.k_low + (axis.k_high - axis.k_low) * (inner / axis.psi) ** 2
            twist = twist - (spring(axis, twist) - gravity[i]) / stiffness
        q_m[i] = axis.n * (q_a[i] - twist)
        u_m[i] = -gravity[i] / (axis.n * axis.gamma)
    return q_m, u_m
