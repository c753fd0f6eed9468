"""The fixed-step integration against SciPy's adaptive one of eighth order, and against itself."""

import math

import numpy as np
import pytest
from hypothesis import given
from scipy.integrate import DOP853
from support.manipulators import CORNERS, T_S, at_rest, constants, table, tcp_distance, uncertain_tables, workspace

from orchestrator.benchmark.linearization import system_matrix
from plant_fmu.flexible_manipulator import integrator, kinematics
from plant_fmu.flexible_manipulator.coefficients import sticking
from plant_fmu.flexible_manipulator.integrator import STATE

NOMINAL = table()
STIFFEST = table(f_d=1.8, f_c=1.8, alpha=1.5)
"""The fastest motion there is in Table 1 is that of a motor against its friction at standstill."""


TCP_ACCURACY, MOTOR_ACCURACY = 1e-8, 2.4e-5
"""What is asked of the plant against the adaptive solution [m], [rad]: of the motors a quarter of the quantum that
their angles are measured in."""

SUBSTEP = STATE + 8
"""Where in the memory the longest substep stands."""


def own(memory):
    """Advance the state over one sample by the plant's integration: a function of state and inputs."""

    def solve(_x, inputs):
        memory[0:6] = inputs
        integrator.advance(memory, T_S)
        return memory[STATE : STATE + 8].copy()

    return solve


def adaptive(values):
    """The same by DOP853, begun anew at every sample, where the inputs jump."""
    arm, joints = constants(values)

    def solve(x, inputs):
        u_m, u_d, F = inputs[0:2], inputs[2:4], inputs[4:6]
        tau = [values[f"gamma[{i + 1}]"] * u_m[i] + u_d[i] for i in range(2)]

        def derivative(_t, y):
            return np.array(integrator.derivative(arm, *joints, tuple(y.tolist()), *tau, *F))

        solver = DOP853(derivative, 0.0, x, T_S, rtol=1e-12, atol=1e-12, first_step=T_S / 2)
        while solver.status == "running":
            solver.step()
        assert solver.status == "finished"
        return solver.y

    return solve


def one_second(values, q_a, solve, held_in_place):
    """States of a manipulator under chirp and force, inputs held over 0.25 ms, shape (4001, 8).

    ``held_in_place`` by a sampled proportional-derivative law; else only its weight is carried, and it gives way.
    """
    memory = at_rest(values, q_a)
    u_m0, q_m_ref = memory[0:2], memory[6:8]
    states = [memory[STATE : STATE + 8].copy()]
    for k in range(4000):
        t = k * T_S
        x, chirp = states[-1], math.sin(2 * math.pi * 7.5 * t * t)
        push = 500.0 if 0.25 <= t < 0.75 else 0.0
        feedback = np.array([45.0, 15.0]) * (x[2:4] - q_m_ref) + np.array([1.5, 0.5]) * x[6:8]
        u_m = u_m0 - feedback if held_in_place else u_m0
        inputs = np.array([*u_m, chirp, -chirp, push * math.cos(0.7), push * math.sin(0.7)])
        states.append(solve(x, inputs))
    return np.array(states)


@pytest.mark.slow  # the reference takes half a minute
@pytest.mark.parametrize(
    ("values", "q_a", "held_in_place"),
    [
        pytest.param(NOMINAL, CORNERS[1], True, id="nominal, held"),
        pytest.param(STIFFEST, CORNERS[1], False, id="stiffest, giving way"),
        pytest.param(NOMINAL, (0.3, -0.9), False, id="nominal within, giving way"),
        pytest.param(STIFFEST, (0.3, -0.9), True, id="stiffest within, held"),
    ],
)
def test_one_second_of_chirp_and_force_is_as_accurate_as_asked(values, q_a, held_in_place):
    """Also the native plant's, which makes the same steps to the last bit."""
    computed = one_second(values, q_a, own(at_rest(values, q_a)), held_in_place)
    reference = one_second(values, q_a, adaptive(values), held_in_place)
    exact, found = (
        np.array([kinematics.tcp(constants(values)[0], *state[:2]) for state in states])
        for states in (reference, computed)
    )
    assert np.ptp(exact, axis=0).max() > 1e-4, "the tool does move"
    assert np.hypot(*(found - exact).T).max() <= TCP_ACCURACY
    assert np.abs(computed[:, 2:4] - reference[:, 2:4]).max() <= MOTOR_ACCURACY


def error_of_substeps(number):
    """Error of every state after 20 ms that begin with a step in all inputs, ``number`` substeps a sample.

    The spring has no breakpoint here: over a kink no method keeps an order above the first few.
    """
    smooth = {"k_high[1]": NOMINAL["k_low[1]"], "k_high[2]": NOMINAL["k_low[2]"]}
    values = {**NOMINAL, **smooth, "gamma[1]": 0.9, "gamma[2]": 1.1}
    inputs = at_rest(values, (0.3, -0.9))[0:6] + (8.0, -6.0, 0.3, 0.3, 200.0, -100.0)
    memory = at_rest(values, (0.3, -0.9))
    memory[SUBSTEP] = T_S / number
    plant, reference = own(memory), adaptive(values)
    x = y = memory[STATE : STATE + 8].copy()
    for _ in range(80):
        x, y = plant(x, inputs), reference(y, inputs)
    return np.abs(x - y)


def test_error_falls_with_the_fourth_power_of_the_substep():
    errors = np.array([error_of_substeps(number) for number in (8, 16, 32)])
    orders = np.log2(errors[:-1] / errors[1:])
    assert np.all((orders > 3.5) & (orders < 4.5)), "nearer to 4 than to any other whole number"


def after(pieces, values=NOMINAL):
    """Memory after ``pieces``, steps [s] of one motion."""
    memory = at_rest(values, (0.3, -0.9))
    memory[0:6] += (1.0, -0.5, 0.3, 0.3, 200.0, -100.0)
    for step in pieces:
        integrator.advance(memory, step)
    return memory


@pytest.mark.parametrize(
    "pieces",
    [
        [0.3 * T_S, 0.7 * T_S] * 400,
        [1e-6, 1e-5, T_S - 1.1e-5] * 400,
        [1e-3] * 100,
        [0.04, 0.0, 0.06],
        [math.pi * 1e-4] * 318 + [0.1 - 318 * math.pi * 1e-4],
    ],
    ids=["0.3", "slivers", "1 ms", "long", "irregular"],
)
def test_any_partition_of_an_interval_leads_to_the_same_state(pieces):
    one, other = after([T_S] * 400), after(pieces)
    assert tcp_distance(other, one[10:12]) <= TCP_ACCURACY
    assert np.abs(other[6:8] - one[6:8]).max() <= MOTOR_ACCURACY


def test_whole_multiples_of_the_sample_time_and_no_step_make_no_difference_at_all():
    for pieces in ([2 * T_S] * 4, [4 * T_S] * 2, [T_S] * 8 + [0.0]):
        np.testing.assert_array_equal(after([T_S] * 8), after(pieces))


def test_substeps_are_shorter_where_friction_is_steeper():
    lengths = [integrator.longest_substep(*constants(table(alpha=factor))) for factor in (0.1, 1.0, 6.0, 60.0)]
    assert lengths[0] == integrator.longest_substep(*constants(table(f_c=0.0, f_d=0.0))) == T_S
    assert lengths[1] == integrator.longest_substep(*constants(STIFFEST)) == T_S / 2
    assert lengths[1] > lengths[2] > lengths[3]
    assert lengths[2] / lengths[3] == pytest.approx(10.0, rel=0.01), "all but Coulomb friction is next to nothing here"


@given(uncertain_tables(), workspace)
def test_rates_are_bounds_of_the_linearized_system(values, q_a):
    """For every direction of the second link: the fastest real rate of the equations linearized at rest."""
    arm, joints = constants(values)
    brakes, slopes = [sticking(own) for own in joints], [own.k_1 for own in joints]
    fastest = np.abs(np.linalg.eigvals(system_matrix(arm, joints, slopes, brakes, math.sin(q_a[1]))).real).max()
    assert fastest <= max(integrator.rates(arm, joints))


@pytest.mark.parametrize("factor", [1.0, 10.0, 100.0])
def test_steep_friction_stays_stable(factor):
    """A motor pushed against its Coulomb friction creeps; at too long a substep it would rattle about standstill,
    and at half of that less."""
    creeping = []
    for refinement in (1, 2):
        memory = at_rest(table(alpha=factor), (0.3, -0.9))
        memory[SUBSTEP] /= refinement
        memory[0:2] += 0.3
        for _ in range(400):
            integrator.advance(memory, T_S)
        creeping.append(memory.copy())
    one, other = creeping
    assert np.all(one[6:8] > at_rest(table(alpha=factor), (0.3, -0.9))[6:8]), "both motors have given way"
    assert tcp_distance(other, one[10:12]) <= TCP_ACCURACY
    assert np.abs(other[6:8] - one[6:8]).max() <= MOTOR_ACCURACY
