"""Parameters and outputs by name, start values, and which parameter is the sample time."""

from __future__ import annotations

from dataclasses import replace

import pytest
from support.descriptions import archive, description, usual, variable
from support.refusals import refusal

from orchestrator.conformance.static import binding_findings
from orchestrator.fmi.connectors import bind_controller
from orchestrator.fmi.lookup import find_outputs, find_parameters
from orchestrator.fmi.variables import variables
from orchestrator.loop.setup import Setup, sample_time_parameter

WHAT = "The controller x.fmu"

GAINS = description(
    [
        variable("K_p[1]", "parameter", start="45"),
        variable("K_p[2]", "parameter", start="15"),
        variable("K", "parameter", kind="Float64", size=2, start="1 2"),
        variable("n", "parameter", kind="Integer"),
        variable("q_m[1]"),
        variable("y", "output"),
    ]
)


def test_parameters_are_found_as_scalars_and_elements():
    found = find_parameters(GAINS, {"K_p[2]": 16.0, "K[2]": 7.0}, WHAT)
    assert {v.name: values for v, values in found.items()} == {"K_p[2]": [16.0], "K": [1.0, 7.0]}


@pytest.mark.parametrize(
    ("name", "what", "nearest"),
    [
        ("K_q[1]", "no-parameter", "K_p[1]"),
        ("Kp1", "no-parameter", "K_p[1]"),
        ("K[3]", "no-parameter", "K"),
        ("K[0]", "no-parameter", "K"),
        ("K", "array-parameter", "K[2]"),
        ("n", "not-settable", "K"),
        ("q_m[1]", "not-settable", "K_p[1]"),
    ],
)
def test_unknown_or_unsettable_parameters_are_refused(name, what, nearest):
    error = refusal(find_parameters, GAINS, {name: 1.0}, WHAT)
    assert (error.what, error.where, error.value) == (what, WHAT, name) and nearest in error.nearest


def test_outputs_by_name():
    assert [v.name for v in find_outputs(GAINS, ["y"], WHAT)] == ["y"]
    error = refusal(find_outputs, GAINS, ["x"], WHAT)
    assert (error.what, error.value, error.nearest) == ("no-output", "x", ("y",))


@pytest.mark.parametrize(
    ("start", "size", "numbers"), [(None, 2, ()), ("3", 1, (3.0,)), ("3", 2, (3.0, 3.0)), ("1 -2e1", 2, (1.0, -20.0))]
)
def test_start_values(start, size, numbers):
    shown = description([variable("x", "parameter", kind="Float64", size=size, start=start)])
    assert variables(shown)["x"].start == numbers


# ---- The sample time ----


def with_parameters(*names):
    return replace(archive(), description=usual(*(variable(name, "parameter", "s") for name in names)))


@pytest.mark.parametrize(
    ("names", "found"),
    [
        ((), None),
        (("T_s",), "T_s"),
        (("Controller.Ts",), "Controller.Ts"),
        (("Filter.ts", "T_s"), "T_s"),
        (("T_s", "Filter.T_s", "Ts"), "T_s"),
        (("T_f",), None),
    ],
)
def test_the_sample_time_is_the_exact_name_or_the_only_one_spelled_so(names, found):
    parameter = sample_time_parameter(with_parameters(*names), Setup())
    assert (parameter.name if parameter else None) == found


def test_two_candidates_for_the_sample_time_are_refused_and_named():
    controller = with_parameters("Filter.T_s", "Ts")
    error = refusal(sample_time_parameter, controller, Setup())
    assert (error.what, error.value, error.nearest) == ("ambiguous-sample-time", "T_s", ("Filter.T_s", "Ts"))
    assert sample_time_parameter(controller, Setup({"Ts": 0.001})) is None


def test_a_sample_time_that_is_set_is_not_given():
    assert sample_time_parameter(with_parameters("T_s"), Setup({"T_s": 0.001})) is None
    controller, setup = with_parameters("T_s"), Setup({"T_s": 0.001})
    subjects = [finding.subject for finding in binding_findings(bind_controller(usual(), WHAT), controller, setup)]
    assert "T_s" not in subjects and "parameters" in subjects
