"""Verdicts by four windows, and the longer simulation of a case in doubt."""

import math
from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from msgspec import structs
from support.closed_loops import PAPER, case
from support.results import trajectory

import build_fmus
from orchestrator import Benchmark, Controller, Variation
from orchestrator.benchmark import one_pass
from orchestrator.benchmark.doubt import doubtful, with_latest_end
from orchestrator.benchmark.metrics import AT_THE_END, continuation_if_in_doubt, expected, judge, measure
from orchestrator.benchmark.scorecard import kind, outcome
from orchestrator.codec import Malformed
from orchestrator.loop.trajectory import Ending, Status
from orchestrator.pairing.pairing import simulate
from orchestrator.pairing.work import check_judgement
from orchestrator.search.member import Member, case_of, names, symbol_of

GAIN, DISTURBANCE = case(3, "slippery", "gain_1"), case(3, "compliant", "disturbance")
LIMITS = PAPER.stability
DYING, SLOW, LASTING = (200.0, 60.0, 40.0, 20.0), (40.0, 34.0, 28.0, 21.0), (20.0, 20.1, 20.0, 20.0)
IRREGULAR = (32.6, 13.6, 18.1, 13.9)
LONG = 12
"""Windows between the case's own end and 60 s; the last of them is short."""


def moving(*amplitudes, frequency=5.0):
    """A motion with these amplitudes [µm] in windows of 3 s, of which four end with the case, at 26 s."""
    begin = 26.0 - 3.0 * 4

    def signal(t):
        windows = np.clip(np.ceil((t - begin) / 3.0) - 1, 0, len(amplitudes) - 1).astype(int)
        return 1e-6 * np.array(amplitudes)[windows] * np.sin(2 * math.pi * frequency * t)

    return signal


def with_doubt(*amplitudes, duration=26.0, z=(0.0,)):
    """The judgement, and whether the case has to go on."""
    found = trajectory(error_x=moving(*amplitudes), error_z=moving(*z), duration=duration)
    return judge(PAPER, GAIN, found), goes_on(found)


def goes_on(found):
    return continuation_if_in_doubt(PAPER, GAIN, measure(PAPER, GAIN, found)) is not None


def judged(*amplitudes, **options):
    return with_doubt(*amplitudes, **options)[0]


@pytest.mark.parametrize(
    ("amplitudes", "verdict", "doubt"),
    [
        ((200.0, 100.0, 50.0, 4.9), "quiet", False),
        (DYING, "ring-down", True),
        ((200.0, 60.0, 30.0, 15.0), "ring-down", False),
        ((200.0, 60.0, 20.0, 7.0), "quiet", False),
        (LASTING, "limit cycle", False),
        (SLOW, "limit cycle", True),
        (IRREGULAR, "limit cycle", True),
        ((9.0, 8.0, 9.0, 8.0), "quiet", True),
        ((9.0, 8.0, 8.0, 9.0), "quiet", True),
        ((60.0, 44.0, 32.0, 24.0), "ring-down", True),
        ((90.0, 91.0, 89.0, 90.0), "limit cycle", False),
        ((40.0, 39.0, 38.0, 37.0), "limit cycle", False),
        ((40.0, 38.0, 35.0, 32.0), "limit cycle", True),
        ((30.0, 31.0, 17.0, 16.7), "limit cycle", True),  # two modes that die and beat
        ((112.0, 62.0, 37.0, 24.5), "ring-down", True),  # a cycle of 12 below a larger ring
        ((100.0, 50.0, 25.0, 12.5), "ring-down", False),
        ((50.0, 2.0, 2.1, 2.0), "quiet", False),
        ((2.0, 14.0, 2.0, 2.0), "quiet", True),  # jumps
        ((14.0, 2.0, 2.0, 14.0), "limit cycle", True),
        ((0.5, 1.0, 2.0, 4.0), "quiet", True),  # grows
        ((2.0, 2.1, 2.2, 2.3), "quiet", False),
        ((2.0, 3.0, 2.9, 3.1), "quiet", False),
    ],
)
def test_the_end_of_a_case_is_judged_by_four_windows(amplitudes, verdict, doubt):
    for found, doubtful_too in (with_doubt(*amplitudes), with_doubt(0.0, z=amplitudes)):
        assert (kind(found, LIMITS), doubtful_too, found.judged_until) == (verdict, doubt, 26.0)


@pytest.mark.parametrize(
    ("x", "z", "verdict", "doubt"),
    [
        ((200.0, 60.0, 30.0, 15.0), (12.0, 12.0, 12.0, 12.0), "limit cycle", False),
        ((200.0, 60.0, 30.0, 15.0), (8.0, 8.0, 8.0, 8.0), "ring-down", True),
        ((200.0, 60.0, 20.0, 7.0), (1.0, 1.0, 1.0, 1.0), "quiet", False),
        ((200.0, 60.0, 30.0, 15.0), (60.0, 30.0, 15.0, 7.0), "ring-down", True),  # in between, it does not fall in each
        ((9.5, 9.5, 9.5, 9.5), (6.7, 6.7, 6.7, 6.7), "limit cycle", False),
        ((3.0, 9.0, 3.0, 9.0), (9.0, 3.0, 9.0, 3.0), "quiet", True),  # changes its direction
    ],
)
def test_each_direction_is_judged_by_its_own_windows(x, z, verdict, doubt):
    for found, doubtful_too in (with_doubt(*x, z=z), with_doubt(*z, z=x)):
        assert (kind(found, LIMITS), doubtful_too) == (verdict, doubt)


@pytest.mark.parametrize("angle", [0.0, 0.5, 0.785, 2.3])
@pytest.mark.parametrize(("cycle", "verdict"), [(12.0, "limit cycle"), (8.0, "ring-down")])
def test_a_cycle_across_a_larger_motion_that_dies_out_is_found_however_the_axes_lie(angle, cycle, verdict):
    """At the case's own end, or else by the longer simulation."""
    along, across = moving(2000.0, 600.0, 180.0, 54.0, 16.0, 5.0, 1.0), moving(cycle)

    def motion(share, other):
        return lambda t: share * along(t) + other * across(t)

    def ended(duration):
        x, z = motion(math.cos(angle), -math.sin(angle)), motion(math.sin(angle), math.cos(angle))
        return trajectory(error_x=x, error_z=z, duration=duration)

    assert goes_on(ended(26.0)) or kind(judge(PAPER, GAIN, ended(26.0)), LIMITS) == verdict
    assert kind(judge(PAPER, GAIN, ended(60.0)), LIMITS) == verdict


@pytest.mark.parametrize(
    ("offset", "speed", "doubt"),
    [(0.15, 2e-3, True), (0.15, 1e-3, False), (0.08, 2e-3, False), (0.5, 2e-3, False)],
)
def test_an_arm_that_creeps_to_rest_is_waited_for(offset, speed, doubt):
    """``offset`` [mm] at the end, which falls at ``speed`` [mm/s]; a constant one is no reason to wait."""

    def creeping(t):
        return 1e-3 * (offset + speed * (26.0 - t)) * (t > 12.0)

    found = trajectory(error_x=creeping, duration=26.0)
    assert (judge(PAPER, GAIN, found).status is Status.UNSTABLE, goes_on(found)) == (offset > 0.1, doubt)


@pytest.mark.parametrize(
    ("later", "verdict", "amplitude"),
    [
        ((10.0, 5.0, 1.0, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5, 0.5), "ring-down", 0.5),
        ((14.0, 15.0, 12.0, 11.0, 10.0, 14.0, 14.0, 14.0, 14.0, 14.0, 16.0, 9.0), "limit cycle", 16.0),
        ((14.0, 15.0, 12.0, 11.0, 10.0, 14.0, 9.0, 9.0, 9.0, 8.0, 9.0, 9.0), "limit cycle", 13.9),
        ((14.0, 14.0, 14.0, 13.0, 13.0, 13.0, 13.0, 13.0, 12.0, 11.0, 8.5, 7.0), "ring-down", 8.5),
        ((14.0, 14.0, 14.0, 13.0, 13.0, 13.0, 13.0, 13.5, 13.0, 12.0, 11.5, 11.0), "limit cycle", 11.5),
    ],
)
def test_a_longer_simulation_is_judged_at_its_own_end(later, verdict, amplitude):
    found, own = judged(*IRREGULAR, *later, duration=60.0), judged(*IRREGULAR)
    assert found.judged_until == 60.0
    assert kind(found, LIMITS) == verdict
    assert found.measurements.limit_cycle == pytest.approx(1e-6 * amplitude, rel=0.02)
    assert found.measurements.limit_cycle_at_end == own.measurements.limit_cycle
    check_judgement(PAPER, GAIN, found)


def test_a_motion_that_was_small_and_stays_small_is_quiet():
    assert kind(judged(9.0, 8.0, 8.0, 9.0, *(9.0,) * 12, duration=60.0), LIMITS) == "quiet"


def test_criteria_are_those_of_the_cases_own_time():
    spike = moving(*IRREGULAR, *(14.0,) * 12)

    def later(t):
        return spike(t) + np.where(np.abs(t - 40.0) < 1.0, 0.5e-3, 0.0)

    found, own = (
        judge(PAPER, DISTURBANCE, trajectory(error_x=later, torque=(np.sqrt, 1.0), duration=end))
        for end in (60.0, 26.0)
    )
    for name in expected(PAPER, DISTURBANCE) - AT_THE_END:
        assert getattr(found.measurements, name) == getattr(own.measurements, name)


@pytest.mark.parametrize("status", [Status.UNSTABLE, Status.ERROR])
def test_what_fails_in_the_longer_simulation_fails_but_keeps_its_criteria(status):
    ended = replace(trajectory(duration=40.0), ending=Ending(status, 40.0, "because"))
    found = judge(PAPER, DISTURBANCE, ended)
    assert (found.status, found.time, found.judged_until) == (status, 40.0, None)
    assert found.measurements.names == expected(PAPER, DISTURBANCE) - AT_THE_END
    check_judgement(PAPER, DISTURBANCE, found)
    assert outcome(found, LIMITS) == {"unstable": "left the workspace"}.get(status.value, "error")
    with pytest.raises(Malformed):
        check_judgement(PAPER, DISTURBANCE, structs.replace(found, time=20.0))
    with pytest.raises(Malformed):
        check_judgement(PAPER, DISTURBANCE, structs.replace(found, time=61.0))


def test_there_is_no_doubt_while_a_disturbance_lasts_or_where_there_is_no_later_end():
    chirp = replace(GAIN.scenario.chirp, start=3.0, stop=27.0)
    shaken = replace(GAIN, scenario=replace(GAIN.scenario, chirp=chirp))
    pushed = replace(GAIN, scenario=replace(GAIN.scenario, pulse=replace(GAIN.scenario.pulse, stop=27.0)))
    ends = structs.replace(PAPER, stability=structs.replace(LIMITS, longest=26.0))
    curves = ([1e-6 * amplitude for amplitude in SLOW], [0.0] * 4)
    assert doubtful(PAPER, GAIN, curves, 0.0)
    assert not any(doubtful(PAPER, other, curves, 0.0) for other in (pushed, shaken))
    assert not doubtful(ends, GAIN, curves, 0.0)
    assert with_latest_end(PAPER, GAIN) == replace(GAIN.scenario, duration=Fraction(60))
    assert with_latest_end(PAPER, GAIN).announced == GAIN.scenario.announced == 60.0
    assert all(with_latest_end(PAPER, other) == other.scenario for other in (pushed, shaken))


def test_one_pass_has_the_same_bits_with_and_without_compilation(monkeypatch):
    def noise(t):
        return 1e-4 * np.random.default_rng(t.size).standard_normal(t.size)

    noisy = trajectory(error_x=noise, error_z=noise, torque=(noise, noise), u_m0=(1e-5, -1e-5), duration=26.0)
    compiled = judge(PAPER, DISTURBANCE, noisy)
    for function in ("pass_over", "project"):
        monkeypatch.setattr(one_pass, function, getattr(one_pass, function).py_func)
    assert judge(PAPER, DISTURBANCE, noisy) == compiled
    error = noisy.tcp_error
    assert error[noisy.time >= 10.0].max() == compiled.measurements.B5
    assert compiled.measurements.rest_error == error[noisy.time >= 25.0].max()


# Closed loops

STRICT = Benchmark("strict")
SMALL_FRICTION = {"f_c[1]": 0.418, "f_c[2]": 1.765, "mu_k[1]": 0.2576, "mu_k[2]": 0.2504}


def changed(system, parameters):
    """Deviations of all parameters of a system, with some ``parameters`` [SI] changed."""
    signs, rules, nominal = STRICT.rules.systems[system], STRICT.rules, STRICT.nominal
    found = {name: float(signs.get(symbol_of(name), 0)) for name in names(rules)}
    found |= {
        name: (value / nominal[name] - 1) / rules.uncertainty[symbol_of(name)] for name, value in parameters.items()
    }
    return tuple(found.items())


def swept(*frequencies, test, gain):
    member = Member((104.28, -46.41), test, changed("slippery", SMALL_FRICTION), gain=(gain, 1.0))
    return case_of(replace(member, sweep=frequencies), STRICT.rules, STRICT.nominal)


def at(q_a, system, gain=None):
    return STRICT.case_at(tuple(map(math.radians, q_a)), system, "gain_1", Variation(gain=gain))


DIAGONAL = STRICT.case_at(
    (math.radians(72.0), math.radians(-180.0)),
    "compliant",
    "gain_2",
    Variation(gain=(1.0, 3.5), delay=(Fraction(1, 4000), Fraction(3, 4000))),
)
"""A cycle of 9.9 µm in x and 7.9 µm in z."""


@pytest.mark.slow
@pytest.mark.needs("compiler")
@pytest.mark.parametrize(
    ("controller", "case", "verdict", "until"),
    [
        ("DiagonalPID_C", DIAGONAL, "limit cycle", 60.0),
        ("DiagonalPID_C", at((72.0, -50.0), "slippery", (8.25, 1.0)), "limit cycle", 60.0),
        ("DitheredLQG_C", at((-90.0, -90.0), "sticky"), "ring-down", 60.0),
        ("RobustLQG", swept(0.0, 15.0, test="disturbance_90", gain=4.5), "limit cycle", 60.0),
        ("RobustLQG", swept(0.0, 15.0, test="gain_1", gain=4.0), "limit cycle", 60.0),
        ("RobustLQG", swept(15.0, 0.0, test="gain_1", gain=4.0), "limit cycle", 60.0),
    ],
)
def test_verdicts_of_closed_loops(controller, case, verdict, until, fmu_folder):
    own = Controller(build_fmus.build(controller, fmu_folder))
    found = STRICT.simulate(own, case)
    assert (found.kind, found.result.judged_until, found.ending.time) == (verdict, until, until)
    if controller == "DitheredLQG_C":
        (result,) = STRICT.evaluate(own, only=["c20.sticky.gain_1"], recordings=False).cases
        assert (result.status, result.judged_until, result.time) == (Status.DONE, 60.0, 60.0)
        assert result.measurements == found.result.measurements


@pytest.mark.slow
@pytest.mark.needs("compiler")
def test_a_simulation_that_goes_on_has_the_bits_of_one_that_was_long_from_the_start(pid_c_file):
    pairing, wanted = STRICT.sampled(Controller(pid_c_file), at((72.0, -50.0), "slippery", (8.25, 1.0)))
    found = STRICT.simulate(Controller(pid_c_file), wanted)
    whole = simulate(pairing, with_latest_end(STRICT.rules, wanted))
    for name in ("time", "q_m", "X", "measured", "given", "command", "torque"):
        np.testing.assert_array_equal(getattr(found.trajectory, name), getattr(whole, name), strict=True)
