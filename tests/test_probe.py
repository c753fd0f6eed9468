"""The timing probe: it finds each exporter's convention and every sample of latency."""

from __future__ import annotations

import functools
from fractions import Fraction

import pytest
from closed_loops import T_S
from conftest import build_or_skip
from exporters import RECIPES
from python_controllers import python_controller
from stub_fmus import build_stub, pair

from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.controller import Setup, Steady
from orchestrator.cosim.probe import Convention, probe
from orchestrator.execution import isolation
from orchestrator.execution.job import Finished, Job

STEADY = Steady((0.4, -1.1), (9.0, -6.0), (0.3, -0.9))


def measure(setup, sample_time, plant, controller, task):
    return probe(controller, setup, STEADY, sample_time)


def timing(plant, controller, parameters=None, sample_time=T_S):
    """What the probe says of a controller, found out in a child."""
    work = functools.partial(measure, Setup(parameters or {}), sample_time)
    (outcome,) = isolation.run_isolated(Job(open_archive(plant), open_archive(controller), (0,), work, (60.0,)))
    assert isinstance(outcome, Finished), outcome
    return outcome.value


@pytest.mark.parametrize(
    ("name", "convention"),
    [
        ("timing_initialization", Convention.INITIALIZATION),
        ("timing_twice_first", Convention.TWICE),
        ("names_joined", Convention.STEP_START),
        ("position_error", Convention.STEP_START),
        ("container_fmi2", Convention.STEP_START),
        ("pythonfmu3_scalars", Convention.STEP_START),
        ("casadi", Convention.STEP_START),
    ],
)
def test_conventions_of_exporters(name, convention, probe_plant_file, exporter_folder):
    recipe = RECIPES[name]
    if recipe.missing():
        pytest.skip(recipe.missing())
    found = timing(probe_plant_file, recipe.build(exporter_folder))
    assert (found.convention, found.latency) == (convention, 0)
    assert found.first_torque == pytest.approx(STEADY.u_m0, abs=1e-8)


DELAYED = [
    *pair("q_m_ref", "input", "rad", 0.0),
    *pair("q_m", "input", "rad", 0.0),
    *pair("u_m", "output", "N.m"),
    *pair("u_m0", "parameter", "N.m", 0.0),
    ("K", "parameter", "N.m/rad", 45.0),
    ("lag", "parameter", "1", 0.0),
    ("forgetful", "parameter", "1", 0.0),
]


@pytest.fixture(scope="module")
def delayed_file(fmu_folder):
    """The stub of ``tests/stubs/delayed.c``."""
    return build_or_skip(lambda: build_stub("delayed", DELAYED, fmu_folder))


@pytest.mark.parametrize("lag", [0, 1, 2, 7])
def test_every_sample_of_latency_is_seen(lag, probe_plant_file, delayed_file):
    found = timing(probe_plant_file, delayed_file, {"lag": float(lag)})
    assert (found.latency, found.convention) == (lag, Convention.STEP_START)
    assert found.first_torque == STEADY.u_m0


def test_latency_counts_in_the_controllers_own_samples(probe_plant_file, delayed_file):
    assert timing(probe_plant_file, delayed_file, {"lag": 1.0}, Fraction(1, 1000)).latency == 1


def test_no_answer_is_told(probe_plant_file, delayed_file):
    found = timing(probe_plant_file, delayed_file, {"K": 0.0})
    assert found.convention is Convention.SILENT and found.latency is None


def test_an_answer_that_comes_too_late_is_none(probe_plant_file, delayed_file):
    assert timing(probe_plant_file, delayed_file, {"lag": 8.0}).convention is Convention.SILENT


def test_a_response_that_depends_on_when_it_begins_is_told(probe_plant_file, delayed_file):
    """A controller whose gain fades with time."""
    found = timing(probe_plant_file, delayed_file, {"forgetful": 1.0})
    assert found.convention is Convention.UNKNOWN and found.latency == 0


def test_a_unit_delay_in_python_costs_a_sample(probe_plant_file, tmp_path):
    """The output of a step is the law's of the step before: what a unit delay at the output does."""
    body = "before = dict(self.own); self.law(); self.own, self.late = ({**self.own, **getattr(self, 'late', "
    body += "{'u_m[1]': before['u_m0[1]'], 'u_m[2]': before['u_m0[2]']})}, {name: self.own[name] for name in "
    body += "('u_m[1]', 'u_m[2]')}); return True"
    controller = python_controller(tmp_path, "UnitDelay", 45.0, step_body=body)
    found = timing(probe_plant_file, controller)
    assert (found.latency, found.convention) == (1, Convention.STEP_START)
