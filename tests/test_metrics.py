"""What is read off a trajectory, on trajectories whose figures are known beforehand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.closed_loops import PAPER, case
from support.results import trajectory

from orchestrator.benchmark import metrics, one_pass
from orchestrator.benchmark.results import Judgement
from orchestrator.benchmark.scorecard import kind
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


SHORTER = 1.0 - math.cos(math.pi / (2 * one_pass.DIRECTIONS))
"""What the largest extent in some directions may lack of the largest distance, as a share."""


@pytest.mark.parametrize("frequency", [0.5, 7.0, 45.0])
def test_limit_cycle_is_half_the_largest_distance_of_the_TCP_from_itself(frequency):
    def wave(amplitude):
        return lambda t: 3e-5 + amplitude * np.sin(2 * np.pi * frequency * t)

    # A peak between two samples, 0.25 ms apart, is missed by at most 1 - cos(pi f 0.25 ms).
    missed = 1 - math.cos(math.pi * frequency * 0.25e-3) + SHORTER
    for x, z in ((12e-6, 4e-6), (0.0, 12e-6), (-7e-6, 7e-6)):
        size = math.hypot(x, z)
        assert size * (1 - missed) - EXACT <= measured(GAIN, error_x=wave(x), error_z=wave(z)).limit_cycle
        assert measured(GAIN, error_x=wave(x), error_z=wave(z)).limit_cycle <= size + EXACT


def test_a_cycle_along_a_diagonal_is_judged_by_its_length():
    """In neither coordinate it reaches the limit of 10 µm."""

    def wave(amplitude):
        return lambda t: amplitude * np.sin(2 * np.pi * 7.0 * t)

    found = metrics.judge(PAPER, GAIN, trajectory(error_x=wave(9.5e-6), error_z=wave(6.7e-6)))
    assert found.measurements.limit_cycle == pytest.approx(math.hypot(9.5e-6, 6.7e-6), rel=2e-3)
    assert kind(found, PAPER.stability) == "limit cycle"
    assert found.measurements.limit_cycle_frequency == pytest.approx(7.0, abs=0.2)


PATHS = st.lists(st.tuples(*2 * [st.floats(-1.0, 1.0)]), min_size=2, max_size=12)


@given(PATHS, st.floats(0.0, 2.0 * math.pi))
def test_a_rotation_about_the_rest_changes_an_amplitude_by_the_stated_error_at_most(points, angle):
    path = 1e-5 * np.array(points)
    turned = path @ [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    largest = 0.5 * max(math.dist(one, other) for one in path for other in path)
    for X in (path, turned):
        found = one_pass.amplitudes(X + (1.2, -0.7))
        assert largest * (1.0 - one_pass.SHORTER) - EXACT <= found.max() <= largest + EXACT
        assert found[:: one_pass.DIRECTIONS // 2] == pytest.approx(0.5 * np.ptp(X, axis=0), abs=EXACT)
    assert SHORTER <= one_pass.SHORTER < SHORTER + 1e-5


def test_all_figures_of_an_oscillation_are_the_same_in_other_axes():
    def turned(angle):
        def signal(share, across):
            def value(t):
                along = np.where(t < 20.0, 60e-6, 20e-6) * np.sin(2 * np.pi * 7.0 * t)
                return share * along + across * 3e-6 * np.cos(2 * np.pi * 7.0 * t)

            return value

        cosine, sine = math.cos(angle), math.sin(angle)
        return measured(GAIN, error_x=signal(cosine, -sine), error_z=signal(sine, cosine))

    figures = [turned(angle) for angle in (0.0, 0.3, 0.75, 1.6, 2.4)]
    for name in (*metrics.OSCILLATION, "residual_vibration"):
        values = [getattr(found, name) for found in figures]
        assert max(values) - min(values) <= 2.1 * one_pass.SHORTER * max(values), name


def test_limit_cycle_looks_at_the_last_three_seconds_and_rest_error_at_the_last():
    before, within = (measured(GAIN, error_x=spike(at, 1e-3)) for at in (22.9, 23.1))
    assert before.limit_cycle == 0.0 and within.limit_cycle == pytest.approx(0.5e-3, abs=EXACT)
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
