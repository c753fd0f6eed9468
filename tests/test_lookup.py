"""Parameters and outputs by name, start values, and the sample time: its parameter, and where its value comes from."""

from dataclasses import replace
from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.descriptions import T_S, archive, description, usual, variable
from support.refusals import refusal

from orchestrator.conformance.static import binding_findings
from orchestrator.fmi.connectors import bind_controller
from orchestrator.fmi.lookup import elements, find_outputs, find_values
from orchestrator.fmi.variables import variables
from orchestrator.loop.sampling import SampleTime, controller_sample_time
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


def test_parameters_are_found_as_scalars_and_elements_and_outputs_by_name():
    found = find_values(GAINS, {"K_p[2]": 16.0, "K[2]": 7.0}, WHAT)
    assert {v.name: values for v, values in found.items()} == {"K_p[2]": [16.0], "K": [1.0, 7.0]}
    assert [v.name for v in find_outputs(GAINS, ["y"], WHAT)] == ["y"]
    error = refusal(find_outputs, GAINS, ["x"], WHAT)
    assert (error.what, error.value, error.nearest) == ("no-output", "x", ("y",))


@pytest.mark.parametrize(
    ("name", "what", "nearest"),
    [
        ("Kp1", "no-parameter", "K_p[1]"),
        ("K[0]", "no-parameter", "K"),
        ("K", "array-parameter", "K[2]"),
        ("y", "not-settable", "n"),
    ],
)
def test_unknown_or_unsettable_parameters_are_refused(name, what, nearest):
    error = refusal(find_values, GAINS, {name: 1.0}, WHAT)
    assert (error.what, error.where, error.value) == (what, WHAT, name) and nearest in error.nearest


@pytest.mark.parametrize(
    ("start", "size", "numbers"), [(None, 2, ()), ("3", 1, (3.0,)), ("3", 2, (3.0, 3.0)), ("1 -2e1", 2, (1.0, -20.0))]
)
def test_start_values(start, size, numbers):
    shown = description([variable("x", "parameter", kind="Float64", size=size, start=start)])
    assert variables(shown)["x"].start == numbers


def with_parameters(*names):
    return replace(archive(), description=usual(*(variable(name, "parameter", "s") for name in names)))


@pytest.mark.parametrize("names", ["T_f", "T_s", "Controller.Ts", "T_s Filter.ts", "T_s Filter.T_s Ts"])
def test_the_sample_time_is_the_exact_name_or_the_only_one_spelled_so(names):
    first, *_ = names = names.split()
    for shown in (names, names[::-1]):
        parameter = sample_time_parameter(with_parameters(*shown), Setup())
        assert (parameter.name if parameter else "T_f") == first


def test_a_sample_time_that_is_set_is_not_given_and_two_candidates_are_refused():
    controller, setup = with_parameters("T_s"), Setup({"T_s": 0.001})
    assert sample_time_parameter(controller, setup) is None
    subjects = [finding.subject for finding in binding_findings(bind_controller(usual(), WHAT), controller, setup)]
    assert "T_s" not in subjects and "parameters" in subjects
    controller = with_parameters("Filter.T_s", "Ts")
    error = refusal(sample_time_parameter, controller, Setup())
    assert (error.what, error.value, error.nearest) == ("ambiguous-sample-time", "T_s", ("Filter.T_s", "Ts"))
    assert sample_time_parameter(controller, Setup({"Ts": 0.001})) is None


@pytest.mark.parametrize(
    ("name", "unit", "start", "accepted"),
    [
        ("Ts", "s", "0.00025", True),
        ("Ts", "ms", "0.25", True),
        ("Ts", None, None, True),
        ("T_s", "s", "0.001", True),  # the exact name is the documented one
        ("Ts", None, "0.25", False),  # in milliseconds, without a unit
        ("setpointFilter.Ts", "s", "0.05", False),  # the time constant of a filter
    ],
)
def test_a_parameter_that_only_spells_like_it_must_start_with_the_step(name, unit, start, accepted):
    controller = replace(archive(), description=usual(variable(name, "parameter", unit, start=start)))
    if accepted:
        assert sample_time_parameter(controller, Setup()).name == name
    else:
        error = refusal(sample_time_parameter, controller, Setup())
        assert (error.what, error.nearest) == ("ambiguous-sample-time", (name,))
        assert sample_time_parameter(controller, Setup({name: float(start)})) is None


def test_an_array_without_start_values_is_given_whole():
    shown = description([variable("G", "parameter", kind="Float64", size=2)])
    assert refusal(find_values, shown, {"G[1]": 45.0}, WHAT).what == "array-parameter"
    assert list(find_values(shown, {"G[1]": 45.0, "G[2]": 1.0}, WHAT).values()) == [[45.0, 1.0]]


def test_arrays_beyond_any_memory_are_refused():
    shown = description([variable("G", "parameter", kind="Float64", size=3_000_000_000, start="0")])
    assert refusal(variables, shown).what == "bad-description"


@pytest.mark.parametrize("reference", [-1, 2**32, "0x10", None])
def test_a_value_reference_has_32_bits(reference):
    shown = usual()
    shown.modelVariables[0].valueReference = reference
    assert refusal(variables, shown).what == "bad-description"


@pytest.mark.parametrize(
    ("fixed", "experiment", "chosen", "expected", "origin"),
    [
        (None, None, None, T_S, "benchmark"),
        (None, "0.00025", None, T_S, "DefaultExperiment"),
        ("2.5e-4", "0.001", None, T_S, "fixedInternalStepSize"),
        ("0.001", None, None, 4 * T_S, "fixedInternalStepSize"),
        (None, "0.000125", None, T_S / 2, "DefaultExperiment"),
        ("0.00025", "0.00025", 2 * T_S, 2 * T_S, "given"),
    ],
)
def test_where_it_comes_from(fixed, experiment, chosen, expected, origin):
    assert controller_sample_time(archive(fixed, experiment), T_S, chosen) == SampleTime(expected, origin)


ROUNDED = {"8.333333333333333e-05": T_S / 3, "0.0000833333": T_S / 3, "0.00024999999999999995": T_S}


@pytest.mark.parametrize("text", ROUNDED)
def test_a_rounded_decimal_is_freed_from_its_rounding(text):
    assert controller_sample_time(archive(experiment=text), T_S).value == ROUNDED[text]


@given(st.integers(1, 400))
def test_every_multiple_and_fraction_survives_its_decimal_notation(n):
    for exact in (n * T_S, T_S / n):
        assert controller_sample_time(archive(experiment=repr(float(exact))), T_S).value == exact


@pytest.mark.parametrize("text", ["0.0004", "0.0003", "0.01001", "0.000251", "0", "-0.00025", "1e-30", "2.5e-8", "1"])
def test_other_times_than_multiples_and_fractions_are_refused(text):
    error = refusal(controller_sample_time, archive(experiment=text), T_S)
    assert (error.what, error.where, float(error.value)) == ("bad-sample-time", "x.fmu", float(text))
    assert refusal(controller_sample_time, archive(), T_S, Fraction(text)).what == "bad-sample-time", "given ones, too"


@pytest.mark.parametrize("text", ["fast", "nan", "inf", "0,00025", "1/0", "1e9999999999"])
def test_a_step_size_that_is_not_a_number_is_refused(text):
    error = refusal(controller_sample_time, archive(fixed=text), T_S)
    assert (error.what, error.value) == ("bad-sample-time", text)


@pytest.mark.parametrize(
    ("values", "what"),
    [
        ({"K": [45.0, 15.0], "K[1]": 9.0}, "repeated"),
        ({"K[1]": 9.0, "K": [45.0, 15.0]}, "repeated"),
        ({"K": []}, "bad-parameters"),
        ({"K": [45.0]}, "array-parameter"),
    ],
)
def test_no_value_of_a_list_is_lost_or_missing(values, what):
    """One of two values for an element counted, without a word."""
    known = description([variable("K", "parameter", size=2)])
    assert refusal(elements, values, known, "gains").what == what
    assert elements({"K": [45.0, 15.0, 1.0]}, known) == {"K[1]": 45.0, "K[2]": 15.0, "K[3]": 1.0}
