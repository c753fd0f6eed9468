"""The timing probe: it finds each exporter's convention and every sample of latency."""

from __future__ import annotations

from fractions import Fraction

import pytest
from exporters import RECIPES
from support.closed_loops import T_S, probed, quiet
from support.python_controllers import python_controller

from orchestrator.loop.probe import Convention

STEADY = {"rest[1]": 0.4, "rest[2]": -1.1, "hold[1]": 9.0, "hold[2]": -6.0, "q_a_start[1]": 0.3, "q_a_start[2]": -0.9}


def timing(plant, controller, parameters=None, sample_time=T_S):
    """Latency and convention of a controller."""
    found = probed(plant, controller, quiet(sample_time, STEADY, sample_time=sample_time), parameters)
    return found.latency, Convention(found.convention)


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
    assert timing(probe_plant_file, recipe.build(exporter_folder)) == (0, convention)


@pytest.mark.parametrize(
    ("parameters", "sample_time", "latency", "convention"),
    [
        ({}, T_S, 0, Convention.STEP_START),
        ({"lag": 1.0}, T_S, 1, Convention.STEP_START),
        ({"lag": 7.0}, T_S, 7, Convention.STEP_START),
        ({"lag": 1.0}, Fraction(1, 1000), 1, Convention.STEP_START),
        ({"lag": 8.0}, T_S, None, Convention.SILENT),
        ({"K": 0.0}, T_S, None, Convention.SILENT),
        ({"forgetful": 1.0}, T_S, 0, Convention.UNKNOWN),
    ],
    ids=["none", "one", "most", "in its own samples", "too late", "no response", "a gain that fades with time"],
)
def test_every_sample_of_latency_is_seen(
    parameters, sample_time, latency, convention, probe_plant_file, feedthrough_file
):
    found = timing(probe_plant_file, feedthrough_file, {"K": 45.0, **parameters}, sample_time)
    assert found == (latency, convention)


def test_a_unit_delay_in_python_costs_a_sample(probe_plant_file, tmp_path):
    """The output of a step is the law's of the step before: what a unit delay at the output does."""
    body = "before = dict(self.own); self.law(); self.own, self.late = ({**self.own, **getattr(self, 'late', "
    body += "{'u_m[1]': before['u_m0[1]'], 'u_m[2]': before['u_m0[2]']})}, {name: self.own[name] for name in "
    body += "('u_m[1]', 'u_m[2]')}); return True"
    controller = python_controller(tmp_path, "UnitDelay", 45.0, step_body=body)
    assert timing(probe_plant_file, controller) == (1, Convention.STEP_START)
