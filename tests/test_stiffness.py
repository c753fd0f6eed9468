"""Manipulators that the plant's integration cannot follow are refused, and no others."""

import math

import numpy as np
import pytest
from hypothesis import given
from support.closed_loops import PAPER
from support.manipulators import T_S, at_rest, constants, tcp_distance, uncertain_tables
from support.refusals import refusal

from orchestrator.benchmark.stiffness import linearized, require_integrable
from plant_fmu.flexible_manipulator import dynamics, integrator
from plant_fmu.flexible_manipulator.integrator import STATE
from plant_fmu.flexible_manipulator.parameters import NOMINAL


@given(values=uncertain_tables(swapped_stiffness=False))
def test_the_system_matrix_is_the_derivative_of_the_equations_of_motion(values):
    """Without gravity, at straight gears, and far beyond their breakpoint."""
    arm, joints = constants({**values, "g": 0.0})
    q_a = np.array([0.3, -0.9])
    n = np.array([joint.n for joint in joints])
    for bent, far in ((False, 0.0), (True, 10.0 * max(joint.psi for joint in joints))):
        rest = np.array([*q_a, *(n * (q_a - far)), 0.0, 0.0, 0.0, 0.0])
        torques = [-dynamics.spring(joint, far) / joint.n for joint in joints]
        columns = []
        for state, step in enumerate([1e-8, 1e-8, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6, 1e-6]):
            ends = []
            for sign in (-1.0, 1.0):
                x = rest.copy()
                x[state] += sign * step
                ends.append(np.array(integrator.derivative(arm, *joints, tuple(x), *torques, 0.0, 0.0)))
            columns.append((ends[1] - ends[0]) / (2.0 * step))
        numeric = np.column_stack(columns)
        matrix = linearized(arm, joints, bent, float(np.sin(q_a[1])))
        # Bent gears push the links, and their torque turns with these: that is left out, as gravity is.
        states = slice(2, 8) if bent else slice(0, 8)
        difference = np.abs(matrix - numeric)[:, states]
        assert np.all(difference <= 1e-4 * np.abs(numeric).max(axis=0)[states])


def blows_up(changes):
    """Whether the plant at rest, pushed a little, does not stay near for 20 ms, where its links are easiest to turn."""
    memory = at_rest({**NOMINAL, **changes}, (0.3, -math.pi / 2))
    X_0 = memory[10:12].copy()
    memory[STATE + 4 : STATE + 8] += 1e-6
    with np.errstate(all="ignore"):
        for _ in range(80):
            integrator.advance(memory, T_S)
        return not tcp_distance(memory, X_0) < 1e-3


@pytest.mark.parametrize(
    "changes",
    [{}, {"d[1]": 1e5}, {"d[1]": 1e6}, {"k_low[2]": 1e9, "k_high[2]": 1e9}, {"j_m[1]": 1e-4}, {"alpha[1]": 50.0}],
)
def test_what_stays_near_is_accepted(changes):
    require_integrable(changes, PAPER.uncertainty)
    assert not blows_up(changes)


@pytest.mark.parametrize(
    ("changes", "name"),
    [
        ({"d[1]": 1e12}, "d[1]"),
        ({"d[1]": 4e6, "d[2]": 300.0}, "d[1]"),
        ({"g": 1.0, "k_low[2]": 1e12, "k_high[2]": 0.3e6}, "k_low[2]"),
        ({"j_m[1]": 1e-7, "f_c[1]": 0.0, "f_d[1]": 0.0}, "j_m[1]"),
    ],
)
def test_what_blows_up_is_refused_with_the_parameter_to_blame(changes, name):
    error = refusal(require_integrable, changes, PAPER.uncertainty)
    assert (error.what, error.where, error.value) == ("bad-plant-parameter", name, str(changes[name]))
    assert blows_up(changes)


@pytest.mark.parametrize(("name", "value"), [("psi[1]", 1e-300), ("psi[2]", 1e-160), ("l[1]", 1e200), ("m[2]", 1e308)])
def test_coefficients_beyond_all_numbers_are_refused(name, value):
    error = refusal(require_integrable, {name: value, "f_d[1]": 0.01}, PAPER.uncertainty)
    assert (error.what, error.where) == ("bad-plant-parameter", name)


def test_friction_that_takes_a_hundred_substeps_is_refused():
    assert refusal(require_integrable, {"alpha[2]": 1e6}, PAPER.uncertainty).where == "alpha[2]"


def test_the_uncertainty_counts():
    """What is just stable at its nominal value is not at the end of its range."""
    low, high = 1e6, 1e7
    while high - low > 1e3:
        middle = 0.5 * (low + high)
        low, high = (low, middle) if blows_up({"d[1]": middle}) else (middle, high)
    require_integrable({"d[1]": 0.9 * low}, {})
    assert refusal(require_integrable, {"d[1]": 0.9 * low}, PAPER.uncertainty).where == "d[1]"
    assert refusal(require_integrable, {"d[1]": 1.1 * high}, {}).where == "d[1]"
