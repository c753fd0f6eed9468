"""The plan of a sample interval: what acts when, in exact time."""

from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refusal

from orchestrator.exact_time import seconds
from orchestrator.loop.scenario import CELLS, NO_DELAY, Delays, Plan, make_plan

T_S = Fraction(1, 4000)

sample_times = st.sampled_from([Fraction(1, 4000), Fraction(1, 3000), Fraction(1, 7), Fraction(3, 1000)])
ratios = st.fractions(0, 9, max_denominator=12) | st.integers(0, 9).map(Fraction)
jitters = st.just(Fraction(0)) | st.fractions(Fraction(1, 100), 1, max_denominator=100)
holds = st.none() | st.fractions(Fraction(1, 5), 2, max_denominator=6)


def delays(draw_from):
    return st.tuples(draw_from, draw_from)


class Planned(NamedTuple):
    """A plan with what it was made from, times [s]; ``early`` has what a row's measurement is early by its jitter."""

    plan: Plan
    T_s: Fraction
    drive: Delays
    sensor: Delays
    longest: Fraction | None
    early: list[Fraction]

    @property
    def rows(self):
        """For each row its number, and beginnings and ends of its parts, exact."""
        for row, offsets in enumerate(self.plan.offset.tolist()):
            begins = [Fraction(offset, self.plan.denominator) for offset in offsets]
            yield row, begins, [*begins[1:], self.T_s]


@st.composite
def plans(draw):
    T_s = draw(sample_times)
    drive, sensor = (tuple(ratio * T_s for ratio in draw(delays(ratios))) for _ in range(2))
    ratio = draw(holds)
    longest = None if ratio is None else ratio * T_s
    jitter = draw(jitters) * (T_s - max(delay % T_s for delay in sensor))
    if not jitter:
        return Planned(make_plan(T_s, drive, sensor, longest), T_s, drive, sensor, longest, [Fraction(0)])
    cells = np.array(draw(st.lists(st.integers(0, CELLS - 1), min_size=2, max_size=5)))
    plan = make_plan(T_s, drive, sensor, longest, jitter, cells)
    early = [cell * jitter / CELLS + Fraction(1, plan.denominator) for cell in cells[1:].tolist()]
    assert all(cell * jitter / CELLS < time < jitter for cell, time in zip(cells[1:].tolist(), early, strict=True))
    return Planned(plan, T_s, drive, sensor, longest, early)


@given(planned=plans())
def test_parts_fill_the_interval(planned):
    plan, T_s, longest = planned.plan, planned.T_s, planned.longest
    assert Fraction(plan.interval, plan.denominator) == T_s
    assert len(plan.offset) == len(planned.early)
    for row, begins, ends in planned.rows:
        assert begins[0] == 0
        assert all(begin < end for begin, end in zip(begins, ends, strict=True))
        assert [float(end - begin) for begin, end in zip(begins, ends, strict=True)] == plan.step[row].tolist()
        assert longest is None or all(end - begin <= longest for begin, end in zip(begins, ends, strict=True))


@given(planned=plans(), k=st.integers(10, 10**6))
def test_a_command_acts_from_its_delay_until_the_next_one_does(planned, k):
    """Whether the measurement has jitter or not."""
    T_s, drive = planned.T_s, planned.drive
    for row, begins, ends in planned.rows:
        for axis in range(2):
            for begin, end, lag in zip(begins, ends, planned.plan.drive_lag[row, :, axis].tolist(), strict=True):
                arrives, replaced = ((k - lag + later) * T_s + drive[axis] for later in (0, 1))
                assert arrives <= k * T_s + begin and k * T_s + end <= replaced


@given(planned=plans(), k=st.integers(10, 10**6))
def test_a_measurement_is_as_old_as_its_delay_and_its_jitter(planned, k):
    """What the controller gets at sample k is stored with sample k - lag, and was taken at the end of a part of the
    interval before that."""
    plan, T_s, sensor = planned.plan, planned.T_s, planned.sensor
    for row, _, ends in planned.rows:
        for axis in range(2):
            stored = k - int(plan.sensor_lag[axis])
            taken = (stored - 1) * T_s + ends[int(plan.sample_part[row, axis])]
            assert taken == k * T_s - sensor[axis] - planned.early[row]


def test_whole_samples_of_delay_do_not_split_a_step():
    plan = make_plan(T_S, (T_S, 7 * T_S), (T_S, Fraction(0)))
    assert plan.step.tolist() == [[0.25e-3]]
    assert plan.drive_lag.tolist() == [[[1, 7]]]


@pytest.mark.parametrize("jitter", [-T_S / 8, T_S * 5 / 8])
def test_a_measurement_is_not_taken_before_the_interval_that_ends_at_its_sample(jitter):
    sensor, cells = (T_S / 2, 3 * T_S), np.array([0, CELLS - 1])
    make_plan(T_S, NO_DELAY, sensor, None, T_S / 2, cells)
    assert refusal(make_plan, T_S, NO_DELAY, sensor, None, jitter, cells).what == "bad-jitter"


def test_times_without_a_grid_that_integers_can_count_are_refused():
    make_plan(T_S, (Fraction("0.12345678901"), T_S), NO_DELAY)
    assert refusal(make_plan, T_S, (seconds(0.1 * 3), T_S), NO_DELAY).what == "bad-time"
