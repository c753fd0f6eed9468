"""Disturbances that come again: when and in which direction, what is measured of them, and who refuses them."""

import dataclasses
import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import assume, example, given
from hypothesis import strategies as st
from msgspec import structs
from support.refusals import refusal
from support.reports import recording, results_of
from support.results import trajectory

from orchestrator import Benchmark
from orchestrator.benchmark import cases, metrics, protocol, scorecard
from orchestrator.benchmark.doubt import windows_left, with_latest_end
from orchestrator.benchmark.results import CaseResult, Measurements, rules
from orchestrator.benchmark.variation import Variation, vary
from orchestrator.documents import case_plots, results, simulations
from orchestrator.documents.flat_case import flat_case
from orchestrator.documents.ssp import imperfection_values
from orchestrator.loop import signals
from orchestrator.loop.scenario import ChirpSignal, Pulse, PulseSignal, Recurrence, Scenario, later, latest
from orchestrator.loop.trajectory import Status
from orchestrator.recheck import compare
from orchestrator.recheck import signals as rechecked
from plant_fmu.flexible_manipulator.parameters import NOMINAL

RULES = protocol.load("repeated")
RULES_OF = rules(RULES)
CASES = cases.cases(RULES, NOMINAL, 0)
WHOLE = CASES[0]
THREE = replace(WHOLE, scenario=replace(WHOLE.scenario, duration=Fraction(46), again=Recurrence(10.0, 3, 2.4)),
                test=structs.replace(WHOLE.test, duration=Fraction(46)))  # fmt: skip
"""A case with three forces, at 10, 20 and 30 s."""

T_3 = THREE.scenario.chirp.start


# When they come.


@given(
    start=st.integers(0, 20_000),
    length=st.integers(1, 2_000),
    period=st.integers(2_001, 20_000),
    number=st.integers(1, 60),
    rate=st.sampled_from([1000, 4000, 4096, 3000]),
    place=st.floats(0.0, 1.0),
    beside=st.integers(-3, 3),
)
@example(start=50, length=40, period=100, number=5, rate=4000, place=0.6, beside=0)
def test_each_repetition_has_the_samples_that_exact_times_give(start, length, period, number, rate, place, beside):
    """Times in milliseconds; in floats, 0.05 + 3 * 0.1 is above 0.35."""
    n = min(int(place * number), number - 1)
    for edge in (start, start + length):
        k = Fraction(edge + n * period, 1000) * rate // 1 + beside
        assume(k >= 0)
        exact = Fraction(k, rate)
        on = any(start <= 1000 * exact - m * period < start + length for m in range(number))
        signal = PulseSignal(3.0, -4.0, start / 1000, (start + length) / 1000, period / 1000, number, 1.0)
        for pulse in (signals.pulse, signals.pulse.py_func):
            assert (pulse(signal, float(exact)) != (0.0, 0.0)) == on


@given(start=st.floats(0.0, 20.0), period=st.floats(1e-3, 100.0), number=st.integers(1, 100), t=st.floats(0.0, 1e4))
def test_the_latest_repetition_is_the_last_that_has_begun(start, period, number, t):
    begun = [n for n in range(number) if later(start, n, period) <= t]
    assert latest(start, period, number, t) == max(begun, default=-1)


@given(time=st.floats(0.0, 1e4), period=st.floats(0.0, 100.0))
def test_the_first_time_keeps_its_bits(time, period):
    assert later(time, 0, period) == time


def test_the_force_is_turned_and_keeps_its_size():
    once, turn = PulseSignal(300.0, 400.0, 1.0, 1.5), math.radians(137.508)
    many = once._replace(period=10.0, number=30, turn=turn)
    for n in range(30):
        x, z = signals.pulse(many, 10.0 * n + 1.2)
        assert math.hypot(x, z) == pytest.approx(500.0, abs=1e-9)
        assert math.remainder(math.atan2(z, x) - math.atan2(400.0, 300.0) - n * turn, 2 * math.pi) == (
            pytest.approx(0.0, abs=1e-12)
        )
        assert (x, z) == signals.pulse.py_func(many, 10.0 * n + 1.2)
    assert signals.pulse(many, 301.2) == (0.0, 0.0), "the thirtieth was the last"
    assert signals.pulse(many, 1.2) == signals.pulse(once, 1.2) == (300.0, 400.0)


@given(t=st.floats(0.0, 10.0))
def test_the_chirp_is_the_same_each_time_and_the_first_one_has_the_bits_of_one_alone(t):
    once = ChirpSignal(1.0, -1.0, 0.5, 8.0, 0.0, 15.0)
    many = once._replace(period=10.0, number=4)
    assert signals.chirp(many, t) == signals.chirp(once, t)
    whole = round(t * 4000) / 4000
    assert signals.chirp(many, whole + 30.0) == pytest.approx(signals.chirp(once, whole), abs=1e-10)
    assert signals.chirp(many, whole + 40.0) == (0.0, 0.0)


def test_a_table_of_signals_and_the_second_checker_have_the_same_disturbances():
    found = simulations.columns(trajectory(duration=46.0), THREE.scenario)
    scenario, t = THREE.scenario, found["time [s]"]
    assert [np.flatnonzero(found["F_x [N]"])[0], np.flatnonzero(found["F_x [N]"])[-1]] == [40000, 121999]
    own = rechecked_scenario(scenario)
    u_d, F = rechecked.chirp(own, len(t)), rechecked.force(own, len(t))
    np.testing.assert_allclose(F, np.column_stack([found["F_x [N]"], found["F_z [N]"]]), rtol=0, atol=1e-9)
    np.testing.assert_allclose(u_d, np.column_stack([found["u_d[1] [N.m]"], found["u_d[2] [N.m]"]]), rtol=0, atol=1e-9)
    assert len(np.flatnonzero(F[:, 0])) == 3 * 2000


def rechecked_scenario(scenario: Scenario) -> rechecked.RecordedScenario:
    chirp, pulse = scenario.chirp, scenario.pulse
    return rechecked.RecordedScenario(
        *(float(scenario.sample_time), 0.0, (0, 0), 0.0, (1.0, 1.0), (99.0, 99.0), (0.0, 0.0), (0, 0)),
        *(chirp.amplitude, (chirp.start, chirp.stop), (chirp.f_start, chirp.f_stop)),
        *(pulse.force, (pulse.start, pulse.stop)),
        **dataclasses.asdict(scenario.again),
    )


# What is measured.


def spikes(**heights):
    """A signal with these heights [m] in single samples, at times [s] such as ``at_12_5``."""
    times = {float(name.removeprefix("at_").replace("_", ".")): height for name, height in heights.items()}
    return lambda t: sum(np.where(np.abs(t - at) < 1e-4, height, 0.0) for at, height in times.items())


def measured(case, **given):
    return metrics.measure(RULES, case, trajectory(duration=46.0, **given))[0]


@pytest.mark.parametrize(
    ("error", "B5", "B6", "B7"),
    [
        (spikes(at_10_2=7e-3, at_11_5=1e-3), 7e-3, (1.0, 0.0), 0.0),
        (spikes(at_11_5=1e-3, at_22_5=2e-3, at_31=3e-3), 3e-3, (1.0, 2.0), 0.0),
        (spikes(at_11_5=1e-3, at_18=2e-3, at_29=4e-3), 1e-3, (1.0, 0.0), 4e-3),
        (spikes(at_45=1e-3), 1e-3, (0.0, 14.5), 0.0),
        (spikes(at_9=5e-3), 0.0, (0.0, 0.0), 5e-3),
    ],
)
def test_figures_are_the_largest_of_all_forces_and_end_with_the_next_disturbance(error, B5, B6, B7):
    """Chirps begin between 6 and 6.5 s, and 10 s later each time."""
    figures = measured(THREE, error_x=error)
    assert (figures.B6_first, figures.B6_later) == pytest.approx(B6, abs=1e-9)
    assert pytest.approx((B5, max(B6), B7), abs=1e-9) == (figures.B5, figures.B6, figures.B7)
    assert figures.settled


def test_an_error_that_lasts_until_the_next_disturbance_has_not_settled():
    figures = measured(THREE, error_x=lambda t: np.where((t >= 20.0) & (t < 27.0), 1e-3, 0.0))
    assert figures.B6_later == pytest.approx(T_3 + 20.0 - 20.5, abs=1e-3) and not figures.settled
    assert figures.recovery == figures.B6


def test_the_same_motion_is_measured_by_the_second_checker():
    stream = np.random.default_rng(0)
    error = lambda t: 4e-4 * np.exp(-((t - 10.0) % 10.0)) * stream.uniform(0.0, 1.0, len(t))  # noqa: E731
    found = trajectory(duration=46.0, error_x=error)
    figures, _ = metrics.measure(RULES, THREE, found)
    definitions = {"settling_error": 1e-4, "rest_window": 1.0, "limit_cycle_window": 3.0, "limit_cycle_directions": 2.0}
    own = compare.figures(
        rechecked_scenario(THREE.scenario), 46.0, found.X, found.torque, np.array(found.u_m0), definitions
    )
    assert figures.B6 > 0.5
    for name in ("B3", "B4", "B5", "B6", "B7", "rest_error"):
        assert own[name] == pytest.approx(getattr(figures, name), rel=1e-9)


def test_a_case_that_is_cut_short_has_the_figures_of_what_is_left():
    cut = replace(THREE, scenario=replace(THREE.scenario, duration=Fraction(15)))
    names = metrics.expected(RULES, cut)
    assert {"B5", "B6", "B7"} <= names and not names & set(metrics.FIRST_AND_LATER)
    assert "residual_vibration" not in names
    two = replace(THREE, scenario=replace(THREE.scenario, duration=Fraction(30)))
    assert set(metrics.FIRST_AND_LATER) < metrics.expected(RULES, two)


def test_of_disturbances_that_come_once_there_are_no_figures_of_later_ones():
    assert not metrics.expected(RULES, replace(THREE, scenario=replace(THREE.scenario, again=Recurrence()))) & set(
        metrics.FIRST_AND_LATER
    )


def test_in_doubt_a_case_goes_on_after_its_last_force_and_not_before():
    assert with_latest_end(RULES, WHOLE).duration == 350 and windows_left(RULES, WHOLE) == 11
    early = replace(WHOLE, scenario=replace(WHOLE.scenario, duration=Fraction(300)),
                    test=structs.replace(WHOLE.test, duration=Fraction(300)))  # fmt: skip
    assert windows_left(RULES, early) == 0, "a force is yet to come"


def result(configuration, first, last) -> CaseResult:
    figures = Measurements(B6=max(first, last), B6_first=first, B6_later=last)
    pose = replace(WHOLE.configuration, index=configuration)
    return CaseResult(
        status=Status.DONE, time=46.0, measurements=figures, id=str((configuration, first)), configuration=pose,
        system="", test="disturbance",
    )  # fmt: skip


def test_the_first_force_and_the_later_ones_are_means_of_the_worst():
    found = [result(0, 1.0, 2.0), result(0, 0.5, 4.0), result(1, 3.0, 1.0)]
    assert scorecard.first_and_later(found) == (2.0, 2.5)
    assert scorecard.first_and_later([structs.replace(found[0], measurements=Measurements(B6=1.0))]) is None
    assert scorecard.first_and_later([]) is None


# The protocol.


def test_the_protocol_has_thirty_forces_all_around_and_time_to_settle():
    assert len(CASES) == RULES.case_count == 12
    for case in CASES:
        scenario = case.scenario
        assert scenario.again.number == 30 and scenario.duration - Fraction(scenario.disturbed_until) == Fraction(
            "15.5"
        )
        pairs = list(zip(scenario.repetitions, scenario.repetitions[1:], strict=False))
        assert all(5.5 <= after.begin - before.release <= 6.0 for before, after in pairs)
        angles = sorted((n * scenario.again.turn) % (2 * math.pi) for n in range(30))
        gaps = np.diff([*angles, angles[0] + 2 * math.pi])
        assert gaps.max() < math.radians(22.0)
    assert scorecard.score(RULES_OF, []).cost is None and not {"B1", "B2"} & set(RULES.tests[0].criteria)


TABLES = {
    "again = { period = 10, number = 1 }": "number",
    "again = { period = 0, number = 2 }": "period",
    "again = { period = 10, number = 2 }\ndisturbed = false": "no disturbance that could come again",
    "again = { period = 4, number = 2 }": "comes again after 4 s",
    "again = { period = 10, number = 5 }": "ends before its 5 forces do",
    "again = { period = 10, number = 2 }\n[disturbance]\nt_4 = 10.2": "chirp is not before its force",
}


@pytest.mark.parametrize("text", TABLES)
def test_times_that_make_no_sense_are_refused(text, tmp_path):
    file = tmp_path / "mine.toml"
    file.write_text(
        f'extends = "repeated"\n[[tests]]\nname = "x"\nsystems = "performance"\nduration = 46\n{text}\n',
        encoding="utf-8",
    )
    error = refusal(protocol.load, file)
    assert error.what == "bad-protocol" and TABLES[text] in str(error)


def test_a_variation_moves_all_forces_and_is_refused_where_they_would_overlap():
    varied = vary(THREE.scenario, RULES, Variation(t_1=9.75, t_2=10.0))
    assert [each.force for each in varied.repetitions] == [9.75, 19.75, 29.75]
    for wrong in (Variation(t_2=17.0), Variation(t_4=10.25)):
        assert refusal(vary, THREE.scenario, RULES, wrong).what == "bad-repetition"


# Others.


def test_what_has_one_force_alone_refuses_them(tmp_path, pid_c_file):
    assert refusal(imperfection_values, THREE.scenario).what == "no-ssp"
    assert refusal(flat_case, RULES, THREE).what == "no-ssp"
    file = tmp_path / "listed.toml"
    file.write_text(
        'extends = "repeated"\n[[tests]]\nname = "x"\nsystems = "performance"\nduration = 46\n'
        'criteria = ["B5"]\nagain = { period = 10, number = 3 }\n',
        encoding="utf-8",
    )
    assert refusal(Benchmark().robustness, pid_c_file, protocol=file, budget=1000).what == "again"


def test_a_recording_tells_all_forces_and_its_page_shows_them():
    entry = recording(("B5",))
    several = replace(entry, about=structs.replace(entry.about, again=Recurrence(10.0, 2, math.pi / 2), time=26.0))
    first, second = several.about.pushes
    assert (first.force, first.window, first.until) == ((300.0, 400.0), (10.0, 10.5), 10.5)
    assert second.force == pytest.approx((-400.0, 300.0)) and second.window == (20.0, 20.5)
    assert [band.low for band in case_plots.disturbances(several)] == [0.5, 10.5, 10.0, 20.0]
    assert [band.low for band in case_plots.disturbances(entry)] == [0.5, 10.0]


def test_a_recording_is_held_against_the_largest_error_of_any_force():
    entry = recording(("B5",))
    t = np.array([0.0, 10.2, 15.0, 20.2, 26.0], dtype=np.float32)
    motion = np.zeros((5, 5), dtype=np.float32)
    motion[:, 0], motion[:, 1] = t, (0.0, 1e-3, 9e-3, 2e-3, 0.0)
    about = structs.replace(entry.about, again=Recurrence(10.0, 2), chirp=(4.0, 8.0, 0.0, 15.0))
    several = replace(entry, about=about, motion=motion)
    told = results.contradictions(results.Run(results_of(), (several,)))
    assert any("0.002 in the recording" in line for line in told if "B5" in line), "9 mm are those of the chirp"


def test_the_neutral_value_is_once():
    scenario = Scenario(
        parameters=(), duration=Fraction(1), sample_time=Fraction(1, 4000), pulse=Pulse((1.0, 0.0), 0.1, 0.2)
    )
    assert scenario.again == Recurrence() and scenario.repetitions == ((0.0, 0.0, 0.1, 0.2),)
    assert scenario.disturbed_until == 0.2
