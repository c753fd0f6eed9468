"""The bounds of linear controllers: programs with known minima, and a PID as one of the laws they minimize over."""

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import linprog
from scipy.signal import StateSpace

from benchmarks import linear_bound
from benchmarks.cone_program import Ball, ConeProgram, Size
from benchmarks.linear_bound import Laws, Responses, any_law, largest_of, linear_arm, yields
from orchestrator import Benchmark
from orchestrator.benchmark import loop_analysis

T_S, SAMPLES = 0.25e-3, 80
BENCH, POSE = Benchmark("strict", plant_parameters=linear_bound.LINEAR), (math.radians(72.0), math.radians(-50.0))


def around(points, **more):
    """Minimize the radius x[2] of a circle around ``points`` with the centre x[:2]."""
    rows = np.tile(-np.eye(2, 3), (len(points), 1, 1))
    empty = {"linear": np.zeros((0, 3)), "offsets": np.zeros(0)}
    return ConeProgram(np.array([0.0, 0.0, 1.0]), rows, np.array(points), 2, **empty | more)


def test_the_smallest_circle_around_a_triangle():
    found = around([[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)]]).minimize()
    assert_allclose(found.x, [0.5, math.sqrt(1.0 / 12.0), math.sqrt(1.0 / 3.0)], atol=1e-5)
    assert found.bound == pytest.approx(math.sqrt(1.0 / 3.0), rel=1e-6)
    assert found.value == pytest.approx(math.sqrt(1.0 / 3.0), rel=1e-6)


def test_constraints_of_other_kinds():
    """The distances of a point from a disc, and from a half-plane."""
    point = [[3.0, 4.0]]
    disc = around(point, balls=[Ball(slice(0, 2), np.eye(2), np.zeros(2), 1.0)])
    assert disc.minimize().value == pytest.approx(4.0, rel=1e-5)
    half = around(point, linear=np.array([[-3.0, -4.0, 0.0]]), offsets=np.array([10.0]))
    assert half.minimize().value == pytest.approx(3.0, rel=1e-5)
    sum_of_norms = ConeProgram(
        cost=np.array([0.0, 0.0, 1.0, 1.0]),
        rows=np.zeros((0, 2, 4)),
        constants=np.zeros((0, 2)),
        level=2,
        linear=np.array([[1.0, 1.0, 0.0, 0.0]]),
        offsets=np.array([-1.0]),
        sizes=[Size(slice(0, 1), 2), Size(slice(1, 2), 3)],
    )
    assert sum_of_norms.minimize().value == pytest.approx(1.0, rel=1e-5)


def test_norms_of_one_number_are_a_linear_program():
    random = np.random.default_rng(5)
    a, b = random.normal(size=(30, 6)), random.normal(size=30)
    rows = np.pad(a[:, None], ((0, 0), (0, 0), (0, 1)))
    cost = np.append(np.zeros(6), 1.0)
    program = ConeProgram(cost, rows, b[:, None], 6, np.zeros((0, 7)), np.zeros(0))
    both = np.vstack([np.column_stack([sign * a, -np.ones(30)]) for sign in (1.0, -1.0)])
    exact = linprog(cost, both, np.concatenate([-b, b]), bounds=[(None, None)] * 7).fun
    found = program.minimize()
    assert found.bound == pytest.approx(exact, rel=1e-6) and found.value == pytest.approx(exact, rel=1e-6)


def test_the_linear_program_on_a_double_integrator():
    """A unit force from sample 0, a torque of at most 2 that acts from sample 2: it is 2 away until then, and 2 more in
    the two samples in which a net force of -1 takes the speed of 2 away."""
    k = np.arange(60.0)
    p, X = np.zeros((60, 2, 2)), np.zeros((60, 2, 2))
    p[2:, 0, 0] = 1e-6 * (k[2:] - 1.5)
    X[:, 0, 0] = 1e-6 * 0.5 * k**2
    own = Responses(g=p, p=p, y=X, X=X)
    limits = np.array([-2.0, -2.0]), np.array([2.0, 2.0])
    assert any_law(own, np.array([1.0, 0.0]), *limits) == pytest.approx(4e-6, rel=1e-6)


def test_the_largest_of_normal_numbers():
    draws = np.abs(np.random.default_rng(2).normal(size=(20000, 33))).max(axis=1)
    assert largest_of(33) == pytest.approx(draws.mean(), rel=0.01)


@pytest.fixture(scope="module")
def laws():
    return Laws(linear_arm(BENCH, POSE), BENCH, SAMPLES)


@pytest.fixture(scope="module")
def pid():
    """The loop of the arm and a PID, eq. (13), without a filter of the derivative's speed."""
    A, B = np.diag([1.0, 1.0, 0.0, 0.0]), np.vstack([np.eye(2), np.eye(2)])
    K_p, K_i, K_d = np.diag([45.0, 15.0]), np.diag([300.0, 80.0]), np.diag([1.0, 0.4])
    rate = 0.1 / T_S
    A[2:, 2:] = 0.9 * np.eye(2)
    C, D = np.hstack([K_i * T_S, -0.1 * rate * K_d]), K_p + rate * K_d
    return BENCH.linear_loop(
        StateSpace(A, B, C, D, dt=T_S), POSE, "compliant", test=linear_bound.TEST, friction="sliding"
    )


@pytest.fixture(scope="module")
def elements(laws, pid):
    """Q of the loop with the PID: the torques after an impulse of the reference."""
    steps = np.stack([loop_analysis.step(pid.closed, axis, SAMPLES + 1)[:, 4:] for axis in (0, 1)], axis=2)
    impulse = np.diff(steps[:SAMPLES], axis=0, prepend=0.0)
    return laws.sigma * impulse.transpose(1, 2, 0).ravel()


def test_q_of_a_pid_gives_the_errors_of_its_loop(laws, pid, elements):
    steps = np.stack([loop_analysis.step(pid.closed, 4 + axis, SAMPLES)[:, 2:4] for axis in (0, 1)], axis=2)
    program = laws.program()
    vectors = program.rows @ np.append(elements, [0.0, 0.0, 0.0]) + program.constants
    expected = 1e3 * linear_bound.FORCE * np.einsum("kcd,dj->kjc", steps, linear_bound.UNITS)[linear_bound.STRIDE :: 4]
    assert_allclose(vectors, expected.reshape(-1, 2), atol=1e-9 * np.abs(expected).max())


def test_a_pid_is_among_the_laws_that_yield(laws, pid, elements):
    assert pid.stable and yields(pid.model, pid.closed) > 0.0
    steps = np.stack([loop_analysis.step(pid.closed, 4 + axis, 2000)[:, 2:4] for axis in (0, 1)], axis=2)
    program = laws.yielding(laws.program())
    x = np.append(elements, [linear_bound.peak(steps), 0.0, 0.0])
    assert np.all(program.linear @ x + program.offsets > 0.0)
    for axis in (0, 1):
        assert np.linalg.norm(laws.sensitivity(elements, axis), 2) <= pid.margins[axis].sensitivity * (1.0 + 1e-6)


def test_the_bounds_are_below_what_a_pid_reaches(laws, pid, elements):
    steps = np.stack([loop_analysis.step(pid.closed, 4 + axis, 2000)[:, 2:4] for axis in (0, 1)], axis=2)
    noise = [np.linalg.norm(elements[laws.part(axis)]) for axis in (0, 1)]
    reached = float(laws.cost[-3:] @ [linear_bound.peak(steps), *noise])
    free = laws.program()
    lowest, yielding = free.minimize(), laws.yielding(free).minimize()
    assert 0.0 < lowest.bound < yielding.bound < reached


@pytest.mark.parametrize("axis", [0, 1])
def test_the_limit_is_on_what_s_does_to_a_motion(laws, pid, elements, axis):
    motion = np.random.default_rng(axis).normal(size=SAMPLES)
    limit, x = laws.limit(axis, motion), elements[laws.part(axis)]
    plant = pid.plant
    added = loop_analysis.StateSpace(plant.A, plant.B[:, [0, 1, axis]], plant.C, np.zeros((4, 3)), T_S)
    closed = loop_analysis.closed(added, pid.controller)
    size, state = 0.0, np.zeros(len(closed.A))
    for torque in motion:
        size += (torque + closed.C[4 + axis] @ state) ** 2
        state = closed.A @ state + closed.B[:, 2] * torque
    assert np.linalg.norm(limit.rows @ x + limit.constants) == pytest.approx(math.sqrt(size), rel=1e-9)
    assert limit.radius == pytest.approx(linear_bound.SENSITIVITY * np.linalg.norm(motion))


def test_the_page_has_the_figures():
    kept = list(json.loads(linear_bound.DATA.read_text(encoding="utf-8")).values())
    assert linear_bound.table(kept, BENCH) in linear_bound.PAGE.read_text(encoding="utf-8")
    for found in kept:
        assert found["any"] <= found["linear"]["B5"] <= found["loop"] and found["yields"] > 0.0
        assert found["linear"]["V"] <= found["sensitive"]["V"] <= found["yielding"]["V"]
