"""Manipulators that the plant's integration cannot follow are refused, and no others."""

import math

import numpy as np
import pytest
from support.closed_loops import PAPER
from support.manipulators import T_S, at_rest, tcp_distance
from support.refusals import refusal

from orchestrator.benchmark.linearization import require_integrable
from orchestrator.errors import InputError
from plant_fmu.flexible_manipulator import integrator
from plant_fmu.flexible_manipulator.integrator import STATE
from plant_fmu.flexible_manipulator.parameters import NOMINAL


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
        ({"k_low[1]": 1e12}, "k_low[1]"),
        ({"k_low[1]": 4e11, "d[2]": 300.0}, "k_low[1]"),
        ({"g": 1.0, "k_low[2]": 1e12, "k_high[2]": 0.3e6}, "k_low[2]"),
        ({"j_m[1]": 1e-8, "f_c[1]": 0.0, "f_d[1]": 0.0, "d[1]": 0.0}, "j_m[1]"),
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


def test_a_member_with_little_friction_takes_longer_substeps_and_is_looked_at_as_well():
    """With these gears the most damped member is followed in two substeps; the least damped one blows up in one."""
    error = refusal(require_integrable, {"k_low[1]": 6.6e9, "k_high[1]": 1.98e10}, PAPER.uncertainty)
    assert error.what == "bad-plant-parameter"


@pytest.mark.parametrize(("name", "value"), [("alpha[2]", 1e6), ("d[1]", 1e12), ("j_m[1]", 1e-9)])
def test_what_takes_more_than_a_hundred_substeps_is_refused(name, value):
    assert refusal(require_integrable, {name: value}, PAPER.uncertainty).where == name


def test_the_uncertainty_counts():
    """What is just stable at its nominal value is not at the end of its range."""
    low, high = 1e8, 1e12
    while high / low > 1.001:
        middle = math.sqrt(low * high)
        try:
            require_integrable({"k_low[1]": middle}, {})
        except InputError:
            high = middle
        else:
            low = middle
    assert not blows_up({"k_low[1]": low}) and blows_up({"k_low[1]": 20.0 * high})
    assert refusal(require_integrable, {"k_low[1]": 0.9 * low}, PAPER.uncertainty).where == "k_low[1]"
