"""Dropped samples and jitter of the measurement, as docs/timing.md has them.

The plant is the stub of tests/test_timing.py, the controller a gain; with K = -1 N.m/rad and angles that are given
functions of time, command and torque show when the angles were taken and what became of the torques.
"""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.closed_loops import T_S, case, quiet, simulate_all
from support.refusals import refusal
from support.stub_fmus import axes

from orchestrator import Benchmark, Variation
from orchestrator.benchmark.variation import vary
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.random_streams import dropped, jitter_cells
from orchestrator.loop.random_streams import noise as noise_of
from orchestrator.loop.scenario import CELLS, Drive, Noise, Sensor

ARRIVAL, ACTING = ("arrival[1]", "arrival[2]"), ("acting[1]", "acting[2]")
SIGNALS = ("q_m", "X", "measured", "given", "command", "torque")
SEED = (7, 3)
RISING = axes(hold=(0.5, -0.5), rate=(40, -25))
"""Angles that rise and fall, so that no two commands are equal."""

words = st.lists(st.integers(0, 2**32), min_size=1, max_size=6).map(tuple)
probabilities = st.floats(0.0, 1.0)


@pytest.fixture(scope="module")
def probe(probe_plant_file, feedthrough_file):
    """Simulates scenarios with plant stub and gain -1 N.m/rad."""

    def run(*scenarios):
        return simulate_all(probe_plant_file, feedthrough_file, scenarios, (*ARRIVAL, *ACTING), {"K": -1.0})

    return run


def rising(drive=None, sensor=None, duration="0.1"):
    sensor = sensor or Sensor()
    sensor = replace(sensor, noise=replace(sensor.noise, seed=SEED))
    return quiet(duration, RISING, drive=drive or Drive(), sensor=sensor)


# What is drawn


@given(seed=words, probability=probabilities, larger=probabilities, samples=st.integers(0, 300))
def test_a_longer_simulation_begins_with_the_same_losses_and_a_larger_probability_keeps_them(
    seed, probability, larger, samples
):
    few, many = dropped(seed, probability, samples), dropped(seed, probability, 300)
    np.testing.assert_array_equal(few, many[:samples])
    low, high = (dropped(seed, each, 300) for each in sorted((probability, larger)))
    assert not np.any(low & ~high)
    np.testing.assert_array_equal(jitter_cells(seed, CELLS, samples), jitter_cells(seed, CELLS, 300)[:samples])


@pytest.mark.parametrize("probability", [0.0, 0.01, 0.1, 0.5, 1.0])
def test_as_many_samples_are_lost_as_expected_and_one_tells_nothing_of_the_next(probability):
    lost = dropped(SEED, probability, 100_000)
    deviation = math.sqrt(probability * (1.0 - probability) / len(lost))
    assert abs(lost.mean() - probability) <= 4.0 * deviation
    assert abs((lost[1:] & lost[:-1]).mean() - probability**2) <= 8.0 * deviation


def test_the_jitter_is_uniform_and_its_stream_another_one():
    cells = jitter_cells(SEED, CELLS, 100_000)
    assert cells.dtype == np.int64 and cells.min() >= 0 and cells.max() < CELLS
    counts = np.bincount(cells * 16 // CELLS, minlength=16)
    assert np.abs(counts - 6250).max() < 5.0 * math.sqrt(6250)
    normal = noise_of(Noise(1.0, SEED), 100_000)
    signals = np.column_stack([normal, cells, dropped(SEED, 0.5, 100_000)])
    assert np.abs(np.corrcoef(signals.T) - np.eye(4)).max() < 0.015


# What the loop does with it


def test_values_that_change_nothing_leave_every_bit(quick_plant_file, quick_pid_file):
    """A probability at which none of the samples is lost, in a case with all imperfections of the benchmark."""
    plain = replace(case(5, "random_1", "disturbance", seed=1).scenario, duration=Fraction(1, 2))
    drawn = replace(plain, drive=replace(plain.drive, dropout=5e-324))
    lost = replace(plain, drive=replace(plain.drive, dropout=0.1))
    first, second, third = simulate_all(quick_plant_file, quick_pid_file, [plain, drawn, lost])
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
    # The noise is the same, up to the rounding of sum and difference.
    noise = [found.measured - found.q_m for found in (first, third)]
    np.testing.assert_allclose(*noise, rtol=0.0, atol=1e-13)
    assert not np.array_equal(first.torque, third.torque)


def test_if_all_samples_are_lost_the_initial_torque_is_held(probe):
    (found,) = probe(rising(Drive(dropout=1.0, quantum=(0.3, 0.3), delay=(T_S, T_S / 2))))
    assert np.ptp(found.command, axis=0).min() > 2.0
    for axis, torque in enumerate((0.5, -0.5)):
        assert set(found.torque[:, axis]) == set(found.extra[ACTING[axis]][1:]) == {torque}
    assert [found.extra[name][-1] for name in ARRIVAL] == [-1.0, -1.0]


@pytest.mark.parametrize("probability", [0.1, 0.9])
def test_a_lost_sample_holds_the_torques_before_it_on_both_axes_and_delays_come_on_top(probability, probe):
    gain, limit, quantum = (2.5, 1.0), (3.0, 1.5), (0.07, 0.03)
    (found,) = probe(rising(Drive(gain, limit, quantum, (T_S, 3 * T_S), probability)))
    lost, hold = dropped(SEED, probability, 400), np.array([0.5, -0.5])
    assert 0 < lost.sum() < 400
    sent = np.clip(hold + np.array(gain) * (found.command - hold), -np.array(limit), limit)
    expected, former = [], hold
    for k, torque in enumerate(np.rint(sent / quantum) * quantum):
        former = former if lost[k] else torque
        expected.append(former)
    np.testing.assert_allclose(found.torque, expected, rtol=0.0, atol=1e-12)
    for axis, lag in enumerate((1, 3)):
        late = np.concatenate([[hold[axis]] * lag, found.torque[: 400 - lag, axis]])
        np.testing.assert_array_equal(found.extra[ACTING[axis]][1:], late)


@pytest.mark.parametrize("delay", [(0 * T_S, 0 * T_S), (2 * T_S, T_S / 4)], ids=["none", "some"])
def test_both_angles_are_taken_early_by_the_same_time_and_torques_arrive_as_without(delay, probe):
    jitter, samples = T_S * 3 / 4, 400
    sensor = Sensor(Noise(1e-3), delay, 0.0, jitter)
    drive = Drive(delay=(T_S, T_S * 3 / 2))
    with_jitter, without = probe(rising(drive, sensor), rising(drive, replace(sensor, jitter=Fraction(0))))
    early = float(jitter) / CELLS * jitter_cells(SEED, CELLS, samples + 1)
    t, noise = np.arange(samples + 1) * float(T_S), noise_of(Noise(1e-3, SEED), samples + 1)
    for axis, (rate, late) in enumerate(zip((40.0, -25.0), delay, strict=True)):
        expected = rate * (t - early - float(late % T_S)) + noise[:, axis]
        expected[0] = 0.0 if late % T_S else noise[0, axis]  # the arm has been at rest
        np.testing.assert_allclose(with_jitter.measured[:, axis], expected, rtol=0.0, atol=1e-7)
        seen = np.concatenate([np.zeros(late // T_S), with_jitter.measured[:, axis]])[:samples]
        np.testing.assert_array_equal(with_jitter.given[:, axis], seen)
    for name in ARRIVAL:
        assert with_jitter.extra[name][-1] == without.extra[name][-1]
    np.testing.assert_allclose(with_jitter.q_m, without.q_m, rtol=1e-13)
    assert 0.45 * jitter < early.mean() < 0.55 * jitter


def test_a_case_that_goes_on_has_the_same_bits_up_to_its_own_end(quick_plant_file, quick_pid_file):
    plain = case(5, "random_1", "disturbance").scenario
    both = replace(
        plain, sensor=replace(plain.sensor, jitter=T_S / 2), drive=replace(plain.drive, dropout=0.1), chirp=plain.chirp
    )
    scenarios = [replace(both, duration=Fraction(end, 10)) for end in (2, 3)]
    short, long = simulate_all(quick_plant_file, quick_pid_file, scenarios)
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(short, name), getattr(long, name)[: len(getattr(short, name))])


def test_a_simulation_step_by_step_has_the_same_bits(quick_plant_file, quick_pid_file):
    """The caller gives the commands that the controller gave, and is given what the controller was given."""
    from orchestrator.fmi.slaves import load
    from orchestrator.loop.stepwise import Stepwise

    plain = replace(case(5, "random_1", "delay_1").scenario, duration=Fraction(1, 5))
    scenario = replace(plain, sensor=replace(plain.sensor, jitter=T_S / 2), drive=replace(plain.drive, dropout=0.2))
    (expected,) = simulate_all(quick_plant_file, quick_pid_file, [scenario])
    stepwise = Stepwise(load(open_archive(quick_plant_file)), scenario)
    seen = [stepwise.begin(), *(stepwise.step((float(u), float(v))) for u, v in expected.command)]
    assert seen.pop() is None
    np.testing.assert_array_equal(seen, expected.given)
    for name in SIGNALS:
        np.testing.assert_array_equal(getattr(stepwise.trajectory, name), getattr(expected, name))


# Who is asked for it, and who refuses


def test_a_variation_sets_both_and_ideal_removes_them():
    bench = Benchmark()
    plain = bench.case("c07.compliant.gain_1").scenario
    wanted = Variation(dropout=0.25, jitter=T_S / 4)
    varied = vary(plain, bench.rules, wanted)
    assert (varied.drive.dropout, varied.sensor.jitter) == (0.25, T_S / 4)
    neutral = {"sensor": replace(varied.sensor, jitter=Fraction(0)), "drive": replace(varied.drive, dropout=0.0)}
    assert replace(varied, **neutral) == plain
    assert vary(varied, bench.rules, Variation()) == varied
    ideal = vary(varied, bench.rules, Variation(ideal=True))
    assert (ideal.drive, ideal.sensor.jitter) == (Drive(), 0)
    assert repr(wanted) == "Variation(dropout=0.25, jitter=Fraction(1, 16000))"


@pytest.mark.parametrize(("dropout", "what"), [(-0.1, "bad-dropout"), (1.1, "bad-dropout"), (math.nan, "bad-number")])
def test_what_is_no_probability_is_refused(dropout, what):
    assert refusal(Variation, dropout=dropout).what == what


def test_a_jitter_beyond_a_sample_is_refused_by_the_loop(probe):
    assert refusal(probe, rising(sensor=Sensor(jitter=T_S * 5 / 4))).what == "bad-jitter"


@pytest.mark.parametrize("change", [{"dropout": 0.1}, {"jitter": T_S / 2}])
def test_linear_models_refuse_them(change):
    assert refusal(Benchmark().linearize, (0.3, -0.9), variation=Variation(**change)).what == "random-timing"


@pytest.mark.parametrize("change", [{"dropout": 0.1}, {"jitter": T_S / 2}])
def test_packages_for_other_tools_refuse_them(change, pid_c_file, tmp_path):
    bench = Benchmark()
    varied = bench.case_at((0.3, -0.9), variation=Variation(**change))
    assert refusal(bench.export_ssp, pid_c_file, varied, tmp_path / "x.ssp").what == "no-ssp"
