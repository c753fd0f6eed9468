"""What is read off a trajectory, on trajectories whose figures are known beforehand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from support.closed_loops import PAPER, case
from support.results import trajectory

from orchestrator.benchmark import metrics
from orchestrator.benchmark.results import Judgement
from orchestrator.loop.trajectory import Ending, Status

DISTURBANCE = case(3, "compliant", "disturbance")
T_3, T_1, T_2 = DISTURBANCE.scenario.chirp.start, 10.0, 10.5
NOISE = case(3, "compliant", "noise")
GAIN = case(3, "sticky", "gain_1")

EXACT = 1e-15
"""Positions of about 1 m are known to 2e-16 m."""


def spike(at, height, rest=0.0):
    """A signal of ``height`` in the one sample at time ``at``, ``rest`` elsewhere."""
    return lambda t: np.where(np.abs(t - at) < 1e-4, height, rest)


def measured(case, **signals):
    return metrics.measure(PAPER, case, trajectory(**signals))[0]


def test_B1_and_B2_are_distances_from_the_start_torque():
    noise = measured(NOISE, torque=(spike(0.5, 3.2, 3.0), spike(0.7, -2.5, -2.0)), u_m0=(3.0, -2.0), duration=2.0)
    assert pytest.approx((0.2, 0.5)) == (noise.B1, noise.B2)
    assert noise.names == {"B1", "B2"}, "nothing is required of this test"


def test_B3_and_B4_count_gravity():
    figures = measured(DISTURBANCE, torque=(spike(9.0, -8.0, -3.0), 2.0), u_m0=(-3.0, 2.0))
    assert (figures.B3, figures.B4) == (8.0, 2.0)


BEGIN = math.ceil(T_3 * 4000) / 4000


@pytest.mark.parametrize("at", [T_3 - 0.01, BEGIN, 7.9, 9.99975, 10.0, 10.4, 26.0])
def test_force_errors_count_from_t_1_and_chirp_errors_between_t_3_and_t_1(at):
    figures = measured(DISTURBANCE, error_x=spike(at, 3e-3), error_z=spike(at, -4e-3))
    assert pytest.approx(5e-3 if at >= T_1 else 0.0, abs=EXACT) == figures.B5
    assert pytest.approx(5e-3 if BEGIN <= at < T_1 else 0.0, abs=EXACT) == figures.B7


def decay(start, rate):
    """1 mm at t_2, falling exponentially."""
    return lambda t: np.where(t >= start, 1e-3 * np.exp(-rate * np.maximum(t - start, 0.0)), 0.0)


@pytest.mark.parametrize("rate", [0.5, 1.0, 3.0])
def test_B6_is_the_time_of_the_last_sample_outside_the_circle(rate):
    settled = measured(DISTURBANCE, error_x=decay(T_2, rate))
    crossing = math.log(10.0) / rate
    assert crossing - 0.25e-3 <= settled.B6 <= crossing
    assert settled.settled is True


def test_B6_counts_an_error_that_comes_back():
    figures = measured(DISTURBANCE, error_x=decay(T_2, 10.0), error_z=spike(15.0, 0.11e-3))
    assert pytest.approx(4.5, abs=1e-12) == figures.B6
    assert figures.settled is True


def test_B6_counts_an_error_of_exactly_the_limit():
    at_limit = replace(trajectory(), X=np.where(np.arange(104001)[:, None] == 60000, (0.1e-3, 0.0), (0.0, 0.0)))
    figures, _ = metrics.measure(PAPER, DISTURBANCE, at_limit)
    assert (figures.B6, figures.settled) == (4.5, True)


@pytest.mark.parametrize(("error", "B6", "settled"), [(0.09e-3, 0.0, True), (0.2e-3, 26.0 - 10.5, False)])
def test_B6_of_one_that_never_leaves_or_never_settles(error, B6, settled):
    figures = measured(DISTURBANCE, error_x=error)
    assert (pytest.approx(B6, abs=1e-12), settled) == (figures.B6, figures.settled)


@pytest.mark.parametrize("frequency", [0.5, 7.0, 45.0])
def test_limit_cycle_is_half_the_peak_to_peak_of_each_coordinate(frequency):
    def wave(amplitude):
        return lambda t: 3e-5 + amplitude * np.sin(2 * np.pi * frequency * t)

    figures = measured(GAIN, error_x=wave(12e-6), error_z=wave(4e-6))
    x, z = figures.limit_cycle_x, figures.limit_cycle_z
    # A peak between two samples, 0.25 ms apart, is missed by at most 1 - cos(pi f 0.25 ms).
    missed = 1 - math.cos(math.pi * frequency * 0.25e-3)
    assert 12e-6 * (1 - missed) - EXACT <= x <= 12e-6 + EXACT
    assert 4e-6 * (1 - missed) - EXACT <= z <= 4e-6 + EXACT


def test_limit_cycle_looks_at_the_last_three_seconds_and_rest_error_at_the_last():
    before, within = (measured(GAIN, error_x=spike(at, 1e-3)) for at in (22.9, 23.1))
    assert (before.limit_cycle_x, before.limit_cycle_z) == (0.0, 0.0)
    assert (within.limit_cycle_x, within.limit_cycle_z) == pytest.approx((0.5e-3, 0.0), abs=EXACT)
    assert measured(GAIN, error_z=spike(24.9, 1e-3)).rest_error == 0.0
    assert measured(GAIN, error_z=spike(25.1, 1e-3)).rest_error == pytest.approx(1e-3, abs=EXACT)


def test_a_loop_that_does_not_come_to_rest_is_unstable_and_still_measured():
    verdict = metrics.judge(PAPER, DISTURBANCE, trajectory(error_x=0.2e-3))
    assert verdict.status is Status.UNSTABLE and "0.2 mm in the last 1 s" in verdict.message
    assert pytest.approx(0.2e-3, abs=EXACT) == verdict.measurements.B5
    calm = metrics.judge(PAPER, GAIN, trajectory(error_x=0.09e-3))
    assert (calm.status, calm.message) == (Status.DONE, "")
    asked = metrics.judge(PAPER, NOISE, trajectory(error_x=1.0, duration=2.0))
    assert asked.status is Status.DONE, "a test without requirements asks for no rest"


@pytest.mark.parametrize("status", [Status.UNSTABLE, Status.ERROR])
def test_what_ended_early_is_not_measured(status):
    ended = replace(trajectory(), ending=Ending(status, 3.5, "because", 2))
    expected = Judgement(status=status, time=3.5, message="because", warnings=2)
    assert metrics.judge(PAPER, DISTURBANCE, ended) == expected


@pytest.mark.parametrize("case", [NOISE, DISTURBANCE, GAIN], ids=lambda case: case.test.name)
def test_figures_are_those_that_are_expected(case):
    assert measured(case, error_x=1e-5).names == metrics.expected(PAPER, case)
