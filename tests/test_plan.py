"""The plan of a sample interval: what acts when, in exact time."""

from fractions import Fraction

from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refusal

from orchestrator.exact_time import seconds
from orchestrator.loop.plan import make_plan
from orchestrator.loop.scenario import NO_DELAY

sample_times = st.sampled_from([Fraction(1, 4000), Fraction(1, 3000), Fraction(1, 7), Fraction(3, 1000)])
ratios = st.fractions(0, 9, max_denominator=12) | st.integers(0, 9).map(Fraction)
holds = st.none() | st.fractions(Fraction(1, 5), 2, max_denominator=6)


def delays(draw_from):
    return st.tuples(draw_from, draw_from)


@st.composite
def plans(draw):
    """A plan with what it was made from: sample time, delays of drive and sensor, longest part."""
    T_s = draw(sample_times)
    drive, sensor = (tuple(ratio * T_s for ratio in draw(delays(ratios))) for _ in range(2))
    ratio = draw(holds)
    longest = None if ratio is None else ratio * T_s
    return make_plan(T_s, drive, sensor, longest), T_s, drive, sensor, longest


def edges(plan, T_s):
    """Beginnings and ends of the parts, exact."""
    begins = [Fraction(int(offset), plan.denominator) for offset in plan.offset]
    return begins, [*begins[1:], T_s]


@given(planned=plans())
def test_parts_fill_the_interval(planned):
    plan, T_s, _, _, longest = planned
    begins, ends = edges(plan, T_s)
    assert begins[0] == 0
    assert all(begin < end for begin, end in zip(begins, ends, strict=True))
    assert Fraction(plan.interval, plan.denominator) == T_s
    assert [float(end - begin) for begin, end in zip(begins, ends, strict=True)] == plan.step.tolist()
    assert longest is None or all(end - begin <= longest for begin, end in zip(begins, ends, strict=True))


@given(planned=plans(), k=st.integers(10, 10**6))
def test_a_command_acts_from_its_delay_until_the_next_one_does(planned, k):
    plan, T_s, drive, _, _ = planned
    begins, ends = edges(plan, T_s)
    for axis in range(2):
        for begin, end, lag in zip(begins, ends, plan.drive_lag[:, axis].tolist(), strict=True):
            arrives, replaced = ((k - lag + later) * T_s + drive[axis] for later in (0, 1))
            assert arrives <= k * T_s + begin and k * T_s + end <= replaced


@given(planned=plans(), k=st.integers(10, 10**6))
def test_a_measurement_is_as_old_as_its_delay(planned, k):
    """What the controller gets at sample k is stored with sample k - lag, and was taken at the end of a part of the
    interval before that."""
    plan, T_s, _, sensor, _ = planned
    _, ends = edges(plan, T_s)
    for axis in range(2):
        stored = k - int(plan.sensor_lag[axis])
        taken = (stored - 1) * T_s + ends[int(plan.sample_part[axis])]
        assert taken == k * T_s - sensor[axis]


def test_whole_samples_of_delay_do_not_split_a_step():
    T_s = Fraction(1, 4000)
    plan = make_plan(T_s, (T_s, 7 * T_s), (T_s, Fraction(0)))
    assert plan.step.tolist() == [0.25e-3]
    assert plan.drive_lag.tolist() == [[1, 7]]


def test_times_without_a_grid_that_integers_can_count_are_refused():
    T_s = Fraction(1, 4000)
    make_plan(T_s, (Fraction("0.12345678901"), T_s), NO_DELAY)
    assert refusal(make_plan, T_s, (seconds(0.1 * 3), T_s), NO_DELAY).what == "bad-time"
