"""LQG design for the flexible manipulator: from the reference position and the initial torque to a linear recursion.

Everything here needs NumPy alone and runs inside the FMU, at the end of its initialization: no gain is tabulated
and no configuration is special. The steps, each a function:

    pose           link angles and gear slopes from the motors' reference angles and torques (static equilibrium)
    linearize      the flexible-joint model (2)-(7) about that pose, 8 states
    discretize     zero-order hold over one sample
    riccati        discrete algebraic Riccati equation, by doubling
    controller     Kalman filter with disturbance model, LQ state feedback, and the recursion the two make

The nominal values of Table 1 are the design's model of the manipulator; the controller knows no others.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .interface import Weights

ARC_MINUTE = math.pi / (180 * 60)

# Table 1, nominal; one value an axis.
MOTOR_INERTIA = (0.004, 0.001)
"""j_m [kg.m2]."""
GEAR_RATIO = (200.0, 200.0)
K_LOW = (0.5e6, 0.2e6)
"""Gear stiffness at zero deflection [N.m/rad]."""
K_HIGH = (1.5e6, 0.3e6)
"""Gear stiffness beyond the breakpoint [N.m/rad]."""
PSI = (2 * ARC_MINUTE, 3 * ARC_MINUTE)
"""Breakpoint of the gear stiffness [rad]."""
GEAR_DAMPING = (600.0, 200.0)
"""d [N.m.s/rad]."""
LINK_INERTIA = (5.0, 50.0)
"""j [kg.m2]."""
LINK_MASS = (50.0, 150.0)
LINK_LENGTH = (1.0, 1.5)
CENTRE_OF_MASS = (0.5, 0.8)
"""xi [m]."""
ANGLE_QUANTUM = 2 * math.pi / 2**16
"""Resolution of the measured motor angle [rad]."""

STATES = 12
"""Of the controller: joint state (8), motor torque disturbance (2), torque of an outer force (2)."""
LAW_SIZE = STATES + 4
DIVERGED = 1e100
"""Above this the iteration for a Riccati equation will not converge any more."""


class Pose(NamedTuple):
    """Link angles [rad] and slopes of the gears' torque [N.m/rad] in the steady state."""

    q_a: tuple[float, float]
    slope: tuple[float, float]


class Recursion(NamedTuple):
    """The controller, with z its state, u the last torque about u_m0 [N.m], e = q_m - q_m_ref [rad]:

    z+ = step [z, u, e],   torque about u_m0 = -gain z+,   estimated TCP error = tool z+ [m].
    """

    step: np.ndarray
    gain: np.ndarray
    tool: np.ndarray


def deflection(axis: int, load: float) -> float:
    """Deflection [rad] at which the nominal gear of ``axis`` (0 or 1) carries the torque ``load`` [N.m], eq. (5).

    The cubic's single real root by Newton's method, which converges monotonically: the curve is convex for
    k_high > k_low and the start, on its chord or beyond, is not below the root.
    """
    k_3 = (K_HIGH[axis] - K_LOW[axis]) / (3 * PSI[axis] ** 2)
    size, breakpoint_load = abs(load), (K_LOW[axis] + k_3 * PSI[axis] ** 2) * PSI[axis]
    if size > breakpoint_load:
        return math.copysign(PSI[axis] + (size - breakpoint_load) / K_HIGH[axis], load)
    x = size / K_LOW[axis]
    for _ in range(50):
        change = ((K_LOW[axis] + k_3 * x * x) * x - size) / (K_LOW[axis] + 3 * k_3 * x * x)
        x -= change
        if abs(change) <= 1e-15:
            break
    return math.copysign(x, load)


def pose(q_m_ref: tuple[float, float], u_m0: tuple[float, float]) -> Pose:
    """The steady state that belongs to motor angles ``q_m_ref`` [rad] and torques ``u_m0`` [N.m].

    At rest the gear passes on the motor's torque, tau_s(Delta) = -n u_m0, and Delta = q_a - q_m / n.
    """
    deltas = [deflection(i, -GEAR_RATIO[i] * u_m0[i]) for i in (0, 1)]
    k_3 = [(K_HIGH[i] - K_LOW[i]) / (3 * PSI[i] ** 2) for i in (0, 1)]
    slopes = [min(K_LOW[i] + 3 * k_3[i] * deltas[i] ** 2, K_HIGH[i]) for i in (0, 1)]
    q_a = [q_m_ref[i] / GEAR_RATIO[i] + deltas[i] for i in (0, 1)]
    return Pose((q_a[0], q_a[1]), (slopes[0], slopes[1]))


def link_inertia(q_a2: float) -> np.ndarray:
    """Inertia matrix of the links [kg.m2], eq. (3b)-(3d), shape (2, 2)."""
    a_2 = LINK_INERTIA[1] + LINK_MASS[1] * CENTRE_OF_MASS[1] ** 2
    a_1 = LINK_INERTIA[0] + LINK_MASS[0] * CENTRE_OF_MASS[0] ** 2 + LINK_MASS[1] * LINK_LENGTH[0] ** 2 + a_2
    coupling = LINK_MASS[1] * LINK_LENGTH[0] * CENTRE_OF_MASS[1] * math.sin(q_a2)
    return np.array([[a_1 - 2 * coupling, a_2 - coupling], [a_2 - coupling, a_2]])


def tool_jacobian(q_a: tuple[float, float]) -> np.ndarray:
    """TCP velocity per link speed [m], eq. (11), shape (2, 2)."""
    q_12 = q_a[0] + q_a[1]
    elbow_x, elbow_z = -LINK_LENGTH[1] * math.sin(q_12), -LINK_LENGTH[1] * math.cos(q_12)
    return np.array(
        [
            [LINK_LENGTH[0] * math.cos(q_a[0]) + elbow_x, elbow_x],
            [-LINK_LENGTH[0] * math.sin(q_a[0]) + elbow_z, elbow_z],
        ]
    )


def linearize(weights: Weights, at: Pose) -> tuple[np.ndarray, np.ndarray]:
    """The design's model dx/dt = A x + B w about the pose ``at``: two links on elastic gears; shapes (8, 8), (8, 4).

    x = link angles, motor angles [rad], link speeds, motor speeds [rad/s]; w = torques on the motors, torques on the
    links [N.m]. Gravity's slope, 1 % of the gears', is left out.
    """
    stiffness = [weights.stiffness[i] * K_LOW[i] * (at.slope[i] / K_LOW[i]) ** weights.hardening for i in (0, 1)]
    to_gear = np.hstack([np.eye(2), -np.diag(1.0 / np.array(GEAR_RATIO))])
    inverse = np.zeros((4, 4))
    inverse[:2, :2] = np.linalg.inv(link_inertia(at.q_a[1]))
    inverse[2:, 2:] = np.diag(1.0 / np.array(MOTOR_INERTIA))
    A = np.zeros((8, 8))
    A[:4, 4:] = np.eye(4)
    A[4:, :4] = -inverse @ to_gear.T @ np.diag(stiffness) @ to_gear
    A[4:, 4:] = -inverse @ (to_gear.T @ np.diag(GEAR_DAMPING) @ to_gear + np.diag([0.0, 0.0, *weights.friction]))
    B = np.zeros((8, 4))
    B[4:, :2] = inverse[:, 2:]
    B[4:, 2:] = inverse[:, :2]
    return A, B


def discretize(A: np.ndarray, B: np.ndarray, T_s: float) -> tuple[np.ndarray, np.ndarray]:
    """Zero-order hold of dx/dt = A x + B w over ``T_s`` [s]: the exponential of [[A, B], [0, 0]] T_s.

    Taylor's series after halving the time until the norm is below 1/2, then squaring.
    """
    states, inputs = B.shape
    exponent = np.zeros((states + inputs, states + inputs))
    exponent[:states] = np.hstack([A, B]) * T_s
    halvings = max(0, math.frexp(float(np.linalg.norm(exponent, 1)))[1] + 1)
    exponent /= 2.0**halvings
    result = term = np.eye(states + inputs)
    for order in range(1, 16):
        term = term @ exponent / order
        result = result + term
    for _ in range(halvings):
        result = result @ result
    return result[:states, :states], result[:states, states:]


def riccati(A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
    """The stabilizing solution X of X = A' X A - A' X B (R + B' X B)^-1 B' X A + Q, by structured doubling.

    See E. K.-W. Chu, H.-Y. Fan, W.-W. Lin, C.-S. Wang, Structure-preserving algorithms for periodic discrete-time
    algebraic Riccati equations, International Journal of Control 77 (2004). Converges quadratically.
    """
    identity = np.eye(len(A))
    G, H = B @ np.linalg.solve(R, B.T), Q
    for _ in range(60):
        W = identity + G @ H
        inner = np.linalg.solve(W, A)
        G_next = G + A @ np.linalg.solve(W, G) @ A.T
        change = A.T @ H @ inner
        A = A @ inner
        G, H = 0.5 * (G_next + G_next.T), H + 0.5 * (change + change.T)
        size = np.abs(H).max()
        if not size < DIVERGED:
            break
        if np.abs(change).max() <= 1e-14 * size:
            return H
    raise ValueError("the Riccati equation has no stabilizing solution that the doubling algorithm could find")


def controller(weights: Weights, at: Pose, T_s: float) -> Recursion:
    """The LQG controller for the pose ``at`` and the sample time ``T_s`` [s].

    The model's state is z = (x, d, f): joint state, motor torque disturbance [N.m] (a random walk), torque of an
    outer force on the links [N.m] (correlated over ``push_time``). A torque computed at sample k acts from k + 1
    on, so the filter predicts one sample ahead with the torque before and the feedback acts on the prediction: the
    loop's delay needs no other cure.
    """
    A_x, B_x = discretize(*linearize(weights, at), T_s)
    B_m, B_a = B_x[:, :2], B_x[:, 2:]
    fade = math.exp(-T_s / weights.push_time)
    A = np.zeros((12, 12))
    A[:8] = np.hstack([A_x, B_m, B_a])
    A[8:10, 8:10] = np.eye(2)
    A[10:, 10:] = fade * np.eye(2)
    B = np.vstack([B_m, np.zeros((4, 2))])
    C = np.zeros((2, 12))
    C[:, 2:4] = np.eye(2)

    noise = np.zeros((12, 8))
    noise[:8, :2] = B_m * weights.motor_noise
    noise[:8, 2:4] = B_a * weights.arm_noise
    noise[8:10, 4:6] = np.diag(weights.drift)
    noise[10:, 6:] = np.eye(2) * weights.push * math.sqrt(1.0 - fade**2)
    measurement = (weights.angle_noise**2 + ANGLE_QUANTUM**2 / 12) * np.eye(2)
    P = riccati(A.T, C.T, noise @ noise.T, measurement)
    L = A @ P @ C.T @ np.linalg.inv(C @ P @ C.T + measurement)

    tool = np.zeros((2, 12))
    tool[:, :2] = 1e3 * tool_jacobian(at.q_a)
    speed = weights.velocity * np.roll(tool, 4, axis=1)
    lift = np.zeros((2, 12))
    lift[:, 2:4] = weights.motor_angle * np.eye(2)
    rows = np.vstack([tool, speed, lift])
    R = np.diag(np.square(weights.effort))
    # The random walk is not controllable: it is compensated, and the feedback designed for the rest.
    kept = [*range(8), 10, 11]
    A_k, B_k, Q_k = A[np.ix_(kept, kept)], B[kept], (rows.T @ rows)[np.ix_(kept, kept)]
    X = riccati(A_k, B_k, Q_k, R)
    gain = np.zeros((2, 12))
    gain[:, kept] = np.linalg.solve(R + B_k.T @ X @ B_k, B_k.T @ X @ A_k)
    gain[:, 8:10] = np.eye(2)
    return Recursion(np.hstack([A - L @ C, B, L]), gain, 1e-3 * tool)


def law(recursion: Recursion) -> np.ndarray:
    """The recursion as one matrix: (z+, torque about u_m0, estimated TCP error) = law (z, u, e), shape (16, 16)."""
    return np.vstack([recursion.step, -recursion.gain @ recursion.step, recursion.tool @ recursion.step])
