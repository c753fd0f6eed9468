"""The sample time at which a controller runs, and where it comes from."""

from __future__ import annotations

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.descriptions import T_S, archive
from support.refusals import refusal

from orchestrator.exact_time import seconds
from orchestrator.loop.sampling import SampleTime, controller_sample_time


@pytest.mark.parametrize(
    ("fixed", "experiment", "given_value", "expected", "origin"),
    [
        (None, None, None, T_S, "benchmark"),
        (None, "0.00025", None, T_S, "DefaultExperiment"),
        ("0.00025", None, None, T_S, "fixedInternalStepSize"),
        ("2.5e-4", "0.001", None, T_S, "fixedInternalStepSize"),
        ("0.001", None, None, Fraction(1, 1000), "fixedInternalStepSize"),
        (None, "0.000125", None, Fraction(1, 8000), "DefaultExperiment"),
        ("0.00025", "0.00025", Fraction(1, 2000), Fraction(1, 2000), "given"),
    ],
)
def test_where_it_comes_from(fixed, experiment, given_value, expected, origin):
    found = controller_sample_time(archive(fixed, experiment), T_S, given_value)
    assert found == SampleTime(expected, origin)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("8.333333333333333e-05", T_S / 3),
        ("0.0000833333", T_S / 3),
        ("0.00024999999999999995", T_S),
        ("0.0007500000000000001", 3 * T_S),
    ],
)
def test_a_rounded_decimal_is_freed_from_its_rounding(text, expected):
    assert controller_sample_time(archive(experiment=text), T_S).value == expected


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


def test_seconds_are_exact():
    assert seconds(0.00025) == seconds("0.25e-3") == seconds("1/4000") == T_S
    assert seconds("1/3000") == Fraction(1, 3000) and seconds(2) == 2
