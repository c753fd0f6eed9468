"""The equations of motion (2)-(11) linearized at rest in closed form, and sampled as the loop samples them; and whether
the plant's integration, with fixed substeps, can follow changes of the nominal parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Literal, NamedTuple

import numpy as np

from plant_fmu.flexible_manipulator.coefficients import Arm, Joint, arm, joint, sticking
from plant_fmu.flexible_manipulator.parameters import NOMINAL, check

from ..errors import InputError
from ..loop.scenario import Delays, Pair

Friction = Literal["sticking", "sliding"]

AXES = (1, 2)
STATES = tuple(f"{name}[{axis}]" for name in ("q_a", "q_m", "w_a", "w_m") for axis in AXES)
INPUTS = tuple(f"{name}[{axis}]" for name in ("u_m", "u_d", "F") for axis in AXES)
OUTPUTS = tuple(f"{name}[{axis}]" for name in ("q_m", "X") for axis in AXES)


class Rest(NamedTuple):
    """The steady state: link angles and motor angles [rad], commanded torques [N.m], position of the tool [m]."""

    q_a: Pair
    q_m: Pair
    u_m: Pair
    X: Pair


class Matrices(NamedTuple):
    """``dx/dt`` (or the next ``x``) ``= A x + B u``, ``y = C x + D u``, and the names of the states."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    states: tuple[str, ...]


class Mode(NamedTuple):
    """A motion of the linear system: frequency [Hz], and damping ratio, 1 for one that does not swing."""

    frequency: float
    damping: float


def rest(parameters: Mapping[str, float], q_a: Pair) -> Rest:
    """The plant's steady state at the link angles ``q_a`` [rad], as the plant solves for it."""
    from plant_fmu.flexible_manipulator import equilibrium, kinematics  # loads Numba

    links, joints = arm(parameters), (joint(parameters, 1), joint(parameters, 2))
    steady = equilibrium.solve(links, joints, q_a)
    X: Pair = kinematics.tcp(links, *q_a)  # type: ignore[no-untyped-call]  # as it is written in its FMU
    return Rest(q_a, steady.q_m, steady.u_m, X)


def linearized(parameters: Mapping[str, float], at: Rest, friction: Friction, gain: Pair = (1.0, 1.0)) -> Matrices:
    """The derivatives of eq. (2)-(11) ``at`` rest: A of shape (8, 8), B (8, 6), C (4, 8), D (4, 6), which is zero.

    Each is the derivative of a term in closed form: at rest, the Coriolis torques (3h) have none, and the inertia's
    multiplies torques that are in balance. ``sticking`` friction has the slope of eq. (8) at zero speed, f_d + alpha
    f_c; ``sliding`` friction that of the viscous part alone, f_d. ``gain`` multiplies u_m.
    """
    from plant_fmu.flexible_manipulator.kinematics import tool_torque  # loads Numba

    links, joints = arm(parameters), (joint(parameters, 1), joint(parameters, 2))
    (s_1, c_1), (s_12, c_12) = ((math.sin(angle), math.cos(angle)) for angle in (at.q_a[0], sum(at.q_a)))
    bent = [angle - motor * actuator.per_n for angle, motor, actuator in zip(at.q_a, at.q_m, joints, strict=True)]
    # Slope of the gear's torque, eq. (5): cubic within psi, and linear beyond.
    stiffness = [
        actuator.k_1 + 3.0 * actuator.k_3 * delta**2 if abs(delta) <= actuator.psi else actuator.m_1
        for actuator, delta in zip(joints, bent, strict=True)
    ]
    # Derivative of the gravity torques by both angles.
    weight = links.c_2 * s_12 * np.ones((2, 2)) - np.diag([links.c_1 * c_1, 0.0])
    brake = [sticking(actuator) if friction == "sticking" else actuator.f_d for actuator in joints]
    s_2 = math.sin(at.q_a[1])
    pushes = ((1.0, 0.0), (0.0, 1.0))
    jacobian = np.array([tool_torque(links, s_1, c_1, s_12, c_12, *F) for F in pushes])  # type: ignore[no-untyped-call]
    B, C = np.zeros((8, 6)), np.zeros((4, 8))
    B[4:6, 4:] = np.linalg.solve(inertia(links, s_2), jacobian.T)
    for axis, actuator in enumerate(joints):
        B[6 + axis, axis], B[6 + axis, 2 + axis] = gain[axis] * actuator.gamma * actuator.per_j_m, actuator.per_j_m
        C[axis, 2 + axis] = 1.0
    C[2:, :2] = jacobian
    return Matrices(system_matrix(links, joints, stiffness, brake, s_2, weight), B, C, np.zeros((4, 6)), STATES)


def inertia(links: Arm, s_2: float) -> np.ndarray:
    """Inertia matrix of the links [kg.m2], shape (2, 2); ``s_2`` = sin q_a2."""
    J_12 = links.a_2 - links.b * s_2
    return np.array([[links.a_1 - 2.0 * links.b * s_2, J_12], [J_12, links.a_2]])


def system_matrix(
    links: Arm,
    joints: tuple[Joint, Joint],
    stiffness: Sequence[float],
    friction: Sequence[float],
    s_2: float,
    gravity: np.ndarray | float = 0.0,
) -> np.ndarray:
    """The system matrix of eq. (2) at rest, shape (8, 8), for the state (q_a, q_m and their speeds).

    ``stiffness`` [N.m/rad] and ``friction`` [N.m.s/rad] are the slopes of gears and motor friction, one an axis,
    ``gravity`` [N.m/rad] that of the gravity torques, shape (2, 2); ``s_2`` = sin q_a2.
    """
    per_j_m, per_n, d = (
        np.array([getattr(actuator, name) for actuator in joints]) for name in ("per_j_m", "per_n", "d")
    )
    bending = np.hstack([np.eye(2), -np.diag(per_n)])  # of the gears, by the angles of links and motors
    torques = np.hstack([np.asarray(stiffness)[:, None] * bending, d[:, None] * bending])
    braking = np.hstack([np.zeros((2, 6)), np.diag(friction)])
    falling = np.hstack([gravity * np.ones((2, 2)), np.zeros((2, 6))])
    return np.vstack(
        [
            np.hstack([np.zeros((4, 4)), np.eye(4)]),
            -np.linalg.solve(inertia(links, s_2), torques + falling),
            (torques * per_n[:, None] - braking) * per_j_m[:, None],
        ]
    )


def sampled(model: Matrices, T_s: Fraction, delays: Delays) -> Matrices:
    """``model`` with its inputs held over ``T_s`` [s], and u_m acting after ``delays`` [s], of which any part of a
    sample is exact. The torques under way are states behind the others: ``u_m[1] k-1`` was commanded a sample ago."""
    states, size = len(model.A), sum(lags := [math.ceil(delay / T_s) for delay in delays])
    A, B = np.zeros((states + size, states + size)), np.zeros((states + size, model.B.shape[1]))
    A[:states, :states], B[:states] = held(model.A, model.B, T_s)
    names, first = list(model.states), states
    for axis, (delay, lag) in enumerate(zip(delays, lags, strict=True)):
        if lag:
            # Of what is under way, the oldest acts first, and the next one over the rest of the sample.
            late = held(model.A, model.B[:, [axis]], lag * T_s - delay)[1][:, 0]
            A[:states, first + lag - 1] = B[:states, axis] - late
            B[:states, axis] = 0.0
            B[first, axis] = 1.0
            A[range(first + 1, first + lag), range(first, first + lag - 1)] = 1.0
            (B[:states, axis] if lag == 1 else A[:states, first + lag - 2])[:] = late
        names += [f"{INPUTS[axis]} k-{age}" for age in range(1, lag + 1)]
        first += lag
    return Matrices(A, B, np.hstack([model.C, np.zeros((len(model.C), size))]), model.D, tuple(names))


def held(A: np.ndarray, B: np.ndarray, time: Fraction) -> tuple[np.ndarray, np.ndarray]:
    """Zero-order hold over ``time`` [s]: the state's transition matrix, and what a constant input adds."""
    from scipy.linalg import expm  # takes longer to load than all else here

    exponent = np.zeros((len(A) + B.shape[1],) * 2)
    exponent[: len(A)] = np.hstack([A, B]) * float(time)
    result = expm(exponent)
    return result[: len(A), : len(A)], result[: len(A), len(A) :]


def modes(A: np.ndarray, sample_time: float | None) -> tuple[Mode, ...]:
    """The motions of a system matrix, slowest first; conjugate poles are one, and torques under way none."""
    poles = np.linalg.eigvals(A).astype(complex)
    if sample_time is not None:
        # Delays are poles at zero, which have no logarithm.
        poles = np.log(poles[np.abs(poles) > 1e-6]) / sample_time
    sizes = [(abs(pole), pole.real) for pole in poles.tolist() if pole.imag >= 0.0]
    return tuple(Mode(size / (2.0 * math.pi), -real / size if size > 0.0 else 1.0) for size, real in sorted(sizes))


STIFF, DAMPED = ("k_low", "k_high"), ("d", "f_d", "f_c", "alpha")
"""Uncertain parameters whose upper end makes the manipulator's motion faster, and those whose upper end asks for
shorter substeps, but whose lower end lets a motion grow; of the others only the masses matter."""

MAX_SUBSTEPS = 100
"""Largest number of substeps in place of one, where friction is steep: a simulation takes as many times longer."""

MAX_GROWTH = 1.0 + 1e-6
"""Largest growth of a motion per substep: the rigid body's, which is 1, with rounding."""


def require_integrable(changes: Mapping[str, float], uncertainty: Mapping[str, float]) -> None:
    """Refuse manipulators that the plant's integration cannot follow.

    The equations of motion are linearized at rest, without gravity, where friction is steepest; Runge-Kutta's fourth
    order must not amplify any of their motions at the plant's own substep. This is done for the lightest and stiffest
    members of the uncertainty, the most and the least damped one, with gears bent or not and the second link in any
    direction.

    Parameters
    ----------
    changes : mapping
        Changed nominal parameters by FMI name, SI units; each within its physical range.
    uncertainty : mapping
        Half-widths of uncertain parameters relative to their nominal value, by symbol: a protocol's ``uncertainty``.

    Raises
    ------
    InputError
        ``bad-plant-parameter`` with the parameter that is to blame.
    """
    if _is_integrable({**NOMINAL, **changes}, uncertainty):
        return
    # The message names the one change without which it would work, or else the first.
    curing = [name for name in changes if _is_integrable({**NOMINAL, **changes, name: NOMINAL[name]}, uncertainty)]
    name = (curing or list(changes))[0]
    raise InputError(
        f"With the plant's {name} = {changes[name]:g}, the integration is unstable: the motions are too fast for its "
        "step, or a coefficient of the equations of motion is not a finite number.",
        "bad-plant-parameter",
        name,
        changes[name],
    )


def _is_integrable(nominal: Mapping[str, float], uncertainty: Mapping[str, float]) -> bool:
    signs = dict.fromkeys(STIFF, 1.0)
    members = (signs | dict.fromkeys(DAMPED, damping) for damping in (1.0, -1.0))
    return all(_is_followed(_member(nominal, uncertainty, signs)) for signs in members)


def _member(
    nominal: Mapping[str, float], uncertainty: Mapping[str, float], signs: Mapping[str, float]
) -> dict[str, float]:
    """The parameters at the ends of their ranges: at the lower one unless ``signs`` say otherwise."""
    return {
        name: value * (1.0 + signs.get(symbol := name.partition("[")[0], -1.0) * uncertainty.get(symbol, 0.0))
        for name, value in nominal.items()
    }


def _is_followed(member: Mapping[str, float]) -> bool:
    from plant_fmu.flexible_manipulator.integrator import MAX_SUBSTEP, longest_substep  # loads Numba

    try:
        links, joints = arm(member), (joint(member, 1), joint(member, 2))
        coefficients = np.array([*links, *joints[0], *joints[1]])
        brakes = [sticking(actuator) for actuator in joints]
        substep = longest_substep(links, joints)
        if not np.all(np.isfinite(coefficients)) or substep * MAX_SUBSTEPS < MAX_SUBSTEP:
            return False
        # Overflows are expected here, and show in the growth.
        with np.errstate(all="ignore"):
            return all(
                _growth(substep * system_matrix(links, joints, stiffness, brakes, s_2)) <= MAX_GROWTH
                for stiffness in ([actuator.k_1 for actuator in joints], [actuator.m_1 for actuator in joints])
                for s_2 in (-1.0, 0.0, 1.0)
            )
    except (ArithmeticError, np.linalg.LinAlgError):
        return False


def _growth(scaled: np.ndarray) -> float:
    """Largest factor by which a Runge-Kutta step amplifies a motion; ``scaled`` is the step times the system matrix."""
    z = np.linalg.eigvals(scaled)
    # The stability function of the classical Runge-Kutta method, 1 + z + z^2/2 + z^3/6 + z^4/24.
    growth = float(np.max(np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))))
    # Comparisons with NaN are false, and would let it pass.
    return growth if not math.isnan(growth) else math.inf


def check_changes(changes: Mapping[str, float], uncertainty: Mapping[str, float]) -> None:
    """Refuse changed nominal parameters (FMI names, SI units) that no manipulator has, or that the plant's integration
    cannot follow over the ``uncertainty``, a protocol's relative half-widths.

    Raises :class:`InputError` with the parameter's name.
    """
    for name, value in changes.items():
        if name not in NOMINAL:
            raise InputError(
                f"The plant has no nominal parameter {name}. It has: {', '.join(NOMINAL)}. Its link angles are those "
                "of the configuration.",
                "no-plant-parameter",
                "plant",
                name,
                NOMINAL,
            )
        if not math.isfinite(value):
            raise InputError(f"The plant's {name}, {value}, is not a finite number.", "not-finite", name, value)
    try:
        check({**NOMINAL, **changes})
    except ValueError as problem:
        raise InputError(f"The plant's {problem}.", "bad-plant-parameter", "plant") from None
    if changes:
        require_integrable(changes, uncertainty)
