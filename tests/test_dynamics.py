"""The equations of motion against Lagrange's: energies come from the geometry of Figure 2, SymPy does the rest.

Nothing here repeats a formula of eq. (3): what is written down are positions, energies, the stiffness and the
friction as Figures 3 and 4 show them.
"""

import math
from functools import cache

import mpmath
import numpy as np
import pytest
import sympy
from hypothesis import given
from hypothesis import strategies as st
from support.manipulators import constants, table, uncertain_tables, workspace

from orchestrator.benchmark import linearization
from plant_fmu.flexible_manipulator import dynamics, kinematics

EPS = float(np.finfo(float).eps)

ROUNDING = 100 * EPS
"""Two ways to evaluate one expression of some tens of operations differ by that much of its largest term."""

speeds = st.floats(-10.0, 10.0)
motor_speeds = st.floats(-500.0, 500.0)
deflections = st.floats(-5e-3, 5e-3)
forces = st.floats(-500.0, 500.0)
torques = st.floats(-35.0, 35.0)


LINK_SYMBOLS = ("j[1]", "j[2]", "m[1]", "m[2]", "l[1]", "l[2]", "xi[1]", "xi[2]", "g")


@cache
def links():
    """Functions of (parameters, q, w): inertia matrix, Coriolis and gravity torques, energy, TCP and its Jacobian."""
    t = sympy.Symbol("t")
    j_1, j_2, m_1, m_2, l_1, l_2, xi_1, xi_2, g = parameters = sympy.symbols("j_1 j_2 m_1 m_2 l_1 l_2 xi_1 xi_2 g")
    angles = [sympy.Function(name)(t) for name in ("q_1", "q_2")]
    # Figure 2: link 1 points up at q_a1 = 0 and turns towards x; at q_a2 = 0 link 2 stands at a right angle to it.
    upright = sympy.Matrix([sympy.sin(angles[0]), sympy.cos(angles[0])])
    turned = angles[0] + angles[1] + sympy.pi / 2
    along_2 = sympy.Matrix([sympy.sin(turned), sympy.cos(turned)])
    centre_1, centre_2, tool = xi_1 * upright, l_1 * upright + xi_2 * along_2, l_1 * upright + l_2 * along_2

    def kinetic(mass, inertia, centre, turning):
        velocity = centre.diff(t)
        return mass * velocity.dot(velocity) / 2 + inertia * turning**2 / 2

    w = [angle.diff(t) for angle in angles]
    T = kinetic(m_1, j_1, centre_1, w[0]) + kinetic(m_2, j_2, centre_2, w[0] + w[1])
    V = g * (m_1 * centre_1[1] + m_2 * centre_2[1])

    q_1, q_2, w_1, w_2 = state = sympy.symbols("q_1 q_2 w_1 w_2")
    flat = [*zip(w, (w_1, w_2), strict=True), *zip(angles, (q_1, q_2), strict=True)]
    T, V, tool = (expression.subs(flat) for expression in (T, V, tool))
    q, w = sympy.Matrix([q_1, q_2]), sympy.Matrix([w_1, w_2])
    momentum = sympy.Matrix([T]).jacobian(w).T
    M = momentum.jacobian(w)
    C = momentum.jacobian(q) * w - sympy.Matrix([T]).jacobian(q).T
    G = sympy.Matrix([V]).jacobian(q).T
    results = [M.tolist(), list(C), list(G), T + V, list(tool), tool.jacobian(q).tolist()]
    return sympy.lambdify([parameters, state], results, "math", cse=True)


def evaluated(values, q, w):
    """The functions of :func:`links` as arrays, at link angles ``q`` and speeds ``w``."""
    return [np.array(item, dtype=float) for item in links()([values[name] for name in LINK_SYMBOLS], (*q, *w))]


@given(values=uncertain_tables(), q=workspace, w=st.tuples(speeds, speeds))
def test_inertia_coriolis_and_gravity_follow_from_the_energies(values, q, w):
    M, C, G, *_ = evaluated(values, q, w)
    arm, _ = constants(values)
    J_11, J_12, J_22 = dynamics.inertia(arm, math.sin(q[1]))
    np.testing.assert_allclose([[J_11, J_12], [J_12, J_22]], M, rtol=0, atol=ROUNDING * M[0, 0])
    largest = arm.b * (abs(w[0]) + abs(w[1])) ** 2
    np.testing.assert_allclose(dynamics.coriolis(arm, math.cos(q[1]), *w), C, rtol=0, atol=ROUNDING * largest + 1e-300)
    gravity = dynamics.gravity(arm, math.sin(q[0]), math.cos(q[0] + q[1]))
    np.testing.assert_allclose(gravity, G, rtol=0, atol=ROUNDING * (arm.c_1 + arm.c_2))


@given(values=uncertain_tables(), q=workspace, F=st.tuples(forces, forces))
def test_tool_and_the_torques_of_a_force_follow_from_the_geometry(values, q, F):
    *_, tool, J = evaluated(values, q, (0.0, 0.0))
    arm, _ = constants(values)
    np.testing.assert_allclose(kinematics.tcp(arm, *q), tool, rtol=0, atol=ROUNDING)
    angles = math.sin(q[0]), math.cos(q[0]), math.sin(q[0] + q[1]), math.cos(q[0] + q[1])
    found = kinematics.tool_torque(arm, *angles, *F)
    np.testing.assert_allclose(found, J.T @ F, rtol=0, atol=ROUNDING * 2.5 * (abs(F[0]) + abs(F[1])) + 1e-300)


POSES = {  # Figure 2: link 1 up, link 2 along x; stretched out upwards, along x; folded back; and two more
    (0, 0): (1.5, 1.0),
    (0, -90): (0.0, 2.5),
    (90, -90): (2.5, 0.0),
    (0, 90): (0.0, -0.5),
    (-90, 0): (-1.0, 1.5),
    (180, -180): (1.5, -1.0),
}


@pytest.mark.parametrize("q_deg", POSES, ids=str)
def test_tool_position_in_poses_drawn_by_hand(q_deg):
    assert kinematics.tcp(constants(table())[0], *np.radians(q_deg)) == pytest.approx(POSES[q_deg], abs=10 * EPS)


def stiffness(values, axis, delta):
    """Figure 3 as words: k_low at rest, growing with the square of the deflection to k_high at psi, then constant."""
    k_low, k_high, psi = (values[f"{symbol}[{axis}]"] for symbol in ("k_low", "k_high", "psi"))
    return k_low + (k_high - k_low) * min(abs(delta) / psi, 1.0) ** 2


@given(values=uncertain_tables(), axis=st.sampled_from((1, 2)), delta=deflections)
def test_spring_is_the_integral_of_its_stiffness(values, axis, delta):
    joint = constants(values)[1][axis - 1]
    inner = math.copysign(min(abs(delta), values[f"psi[{axis}]"]), delta)
    # Simpson's rule is exact for what is quadratic up to psi, and constant beyond.
    start, middle, end = (stiffness(values, axis, part * inner) for part in (0.0, 0.5, 1.0))
    torque = inner * (start + 4 * middle + end) / 6 + (delta - inner) * stiffness(values, axis, delta)
    assert dynamics.spring(joint, delta) == pytest.approx(torque, rel=20 * EPS, abs=1e-300)


@given(values=uncertain_tables(), axis=st.sampled_from((1, 2)), v=motor_speeds)
def test_friction_is_equation_8(values, axis, v):
    f_d, f_c, mu_k, beta, alpha = (
        mpmath.mpf(values[f"{symbol}[{axis}]"]) for symbol in ("f_d", "f_c", "mu_k", "beta", "alpha")
    )
    with mpmath.workdps(40):
        x = mpmath.mpf(v)
        expected = f_d * x + f_c * (mu_k + (1 - mu_k) * mpmath.sech(beta * x)) * mpmath.tanh(alpha * x)
        error = abs(dynamics.friction(constants(values)[1][axis - 1], v) - expected)
    # Near zero speed tanh is the difference of two numbers near 1: the error is a fraction of f_c, not of the torque.
    assert error <= 8 * EPS * (float(f_c) + abs(float(f_d) * v))


@given(values=uncertain_tables(), axis=st.sampled_from((1, 2)), v=motor_speeds | st.sampled_from((1e-320, 1e4, 1e300)))
def test_friction_is_odd_and_dissipates(values, axis, v):
    joint = constants(values)[1][axis - 1]
    assert dynamics.friction(joint, -v) == -dynamics.friction(joint, v)
    assert 0.0 <= dynamics.friction(joint, v) * math.copysign(1.0, v) < math.inf


@st.composite
def states(draw):
    """A state (q_a, q_m, w, v) with gears bent within three breakpoints."""
    q, w = draw(workspace), (draw(speeds), draw(speeds))
    q_m = [200.0 * (angle - draw(deflections)) for angle in q]
    return (*q, *q_m, *w, draw(motor_speeds), draw(motor_speeds))


def lagrange_accelerations(values, x, tau, F):
    """Accelerations of links and motors by Lagrange's equations, and how far rounding may put them off."""
    q, q_m, w, v = np.split(np.array(x), 4)
    M, C, G, _, _, J = evaluated(values, q, w)
    of = {symbol: np.array([values[f"{symbol}[1]"], values[f"{symbol}[2]"]]) for symbol in ("n", "d", "j_m")}
    joints = constants(values)[1]
    # Springs and friction have tests of their own above; gears act on links and, divided by n, on motors.
    gear = np.array([dynamics.spring(joint, x) for joint, x in zip(joints, q - q_m / of["n"], strict=True)])
    gear += of["d"] * (w - v / of["n"])
    friction = np.array([dynamics.friction(joint, x) for joint, x in zip(joints, v, strict=True)])
    on_links, on_motors = J.T @ F - C - G - gear, tau + gear / of["n"] - friction
    link_terms = np.abs(J.T) @ np.abs(F) + np.abs(C) + np.abs(G) + np.abs(gear)
    motor_terms = np.abs(tau) + np.abs(gear) / of["n"] + np.abs(friction)
    inverse = np.linalg.inv(M)
    accelerations = np.concatenate([inverse @ on_links, on_motors / of["j_m"]])
    # q_a - q_m / n loses digits: both are known to a rounding of the angle, the spring multiplies it by k.
    blur = EPS * max(np.abs(q).max(), 1.0) * max(values[f"k_{end}[{i}]"] for end in ("low", "high") for i in (1, 2))
    rounding = ROUNDING * max(link_terms.max(), 1.0) + blur
    motor_rounding = ROUNDING * max(motor_terms.max(), 1.0) + blur / of["n"]
    return accelerations, np.concatenate([np.abs(inverse).sum(axis=1) * rounding, motor_rounding / of["j_m"]])


def python_accelerations(values, x, tau, F):
    arm, joints = constants(values)
    return np.array(dynamics.accelerations(arm, *joints, x, *tau, *F))


@given(values=uncertain_tables(), x=states(), tau=st.tuples(torques, torques), F=st.tuples(forces, forces))
def test_accelerations_solve_lagranges_equations(values, x, tau, F):
    expected, rounding = lagrange_accelerations(values, x, np.array(tau), np.array(F))
    assert np.all(np.abs(python_accelerations(values, x, tau, F) - expected) <= rounding)


@given(values=uncertain_tables(), q=workspace)
def test_the_linear_model_is_the_derivative_of_lagranges_equations(values, q):
    """At rest, where friction sticks; by central differences, whose error is their step squared, and rounding."""
    at = linearization.rest(values, q)
    model = linearization.linearized(values, at, "sticking")
    gamma = np.array([values["gamma[1]"], values["gamma[2]"]])

    def moved(place, change):
        z = np.array([*q, *at.q_m, 0.0, 0.0, 0.0, 0.0, *at.u_m, 0.0, 0.0, 0.0, 0.0])
        z[place] += change
        accelerations, _ = lagrange_accelerations(values, z[:8], gamma * z[8:10] + z[10:12], z[12:])
        return np.concatenate([z[4:8], accelerations, z[2:4], evaluated(values, z[:2], (0.0, 0.0))[4]])

    steps = [1e-6, 1e-6, 1e-4, 1e-4, *[1e-4] * 4, *[1.0] * 6]
    slopes = np.column_stack([(moved(i, h) - moved(i, -h)) / (2.0 * h) for i, h in enumerate(steps)])
    found = np.block([[model.A, model.B], [model.C, model.D]])
    assert np.all(np.abs(found - slopes) <= 1e-5 * np.abs(slopes).max(axis=0))
