"""SteadyLQG: the switching law that its page tells, without a part that is limited in time."""

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.pid_fmus import built, in_child
from test_robust_lqg import TORQUE_LIMIT, reference, signals_of, torques

import build_fmus
from benchmarks import counterexamples
from benchmarks.claims import claims
from controller_fmu.robust_c.interface import ROWS as ROBUST_ROWS
from controller_fmu.steady_c.interface import LEFT_OUT, ROWS
from orchestrator import Benchmark, Controller
from orchestrator.search.arms import lists

needs_compiler = pytest.mark.needs("compiler")

ENDLESS = {"dither_time": math.inf, "spent": 1.0, "sway": math.inf, "sway_share": 0.0}
ENDLESS |= {"peak_time": math.inf, "peak_regain": 0.0}
"""What SteadyLQG leaves out of RobustLQG, as if it were not there."""

OWN = {"headroom", "threshold", "contrast", "dithered", "hold", "decay"}
OWN |= {"overload", "slow_stiffness[1]", "slow_stiffness[2]", "peak_pause"}
"""Parameters with other values than those of RobustLQG, beside the weights of the damping feedback."""


@pytest.fixture(scope="module")
def file(fmu_folder):
    return built("SteadyLQG", fmu_folder)


def test_it_has_the_parameters_of_robust_lqg_without_the_limits_and_the_weights_of_two_of_its_laws():
    assert {row.name for row in ROBUST_ROWS} - {row.name for row in ROWS} == set(LEFT_OUT)
    own, robust = (
        json.loads((build_fmus.HERE / "controller_fmu" / name).read_text(encoding="utf-8"))["parameters"]
        for name in ("steady_c/steady_weights.json", "robust_c/robust_weights.json")
    )
    changed = {name for name, value in robust.items() if own.get(name) != value}
    assert {name for name in changed if not name.startswith("event_")} == OWN | set(LEFT_OUT)


# So low a threshold of the third law that it begins several times, and short dithers, with high thresholds behind them,
# so that most samples differ if they do not fall slowly. The pause ends between two samples, since the sum of sample
# times in C and the product here may differ in the last bit.
SHORT = {"jump": 1e-4, "jump_contrast": 3.0, "hold": 0.3, "decay": 0.2, "peak_pause": 0.5001}


@needs_compiler
@pytest.mark.slow
@pytest.mark.parametrize(
    ("changed", "parts"),
    [
        pytest.param(
            {"contrast": 1.2, "dithered": 60.0, "ringing": 1.0},
            {"contrast_time": 0.2484, "dithered": 1.0, "event_rise": 0.01},
            id="events by contrast",
        ),
        # Little contrast, so that some of the motions that die out are no event by it.
        pytest.param(
            {"contrast": 6.0, "dithered": 20.0, "ringing": 1e-5},
            {"ringing": 1.0, "ringing_rise": 0.6, "peak_pause": 0.0, "dithered": 1.0},
            id="events by ringing",
        ),
    ],
)
def test_torques_are_those_of_the_law(file, changed, parts):
    """``parts``: values that turn a part of the law off, which then commands other torques."""
    signals, starts = signals_of(file)
    given = SHORT | changed
    expected = reference(signals, {**starts, **ENDLESS, **given}, steady=True)
    assert np.count_nonzero(np.diff(expected.peak) > 0.5) > 2
    assert expected.slowly.any() and not expected.slowly.all() and np.count_nonzero(np.diff(expected.slowly)) > 1
    assert (expected.event == 0).any() and (expected.event == 1).any() and (expected.dither > 0).any()
    for name, off in parts.items():
        without = reference(signals, {**starts, **ENDLESS, **given, name: off}, steady=True)
        assert (np.abs(without.u_m - expected.u_m).max(axis=1) > 0.01).mean() > 0.1, name
    found = in_child(torques, file, signals, given)
    drive = TORQUE_LIMIT / 2**11
    assert_allclose(found / drive, expected.u_m / drive, rtol=0.0, atol=0.05)


@needs_compiler
def test_the_arm_on_which_robust_lqg_fails_a2_comes_to_rest(file):
    (command,) = {claim.command for claim in claims() if claim.figure == "A2"}
    result = counterexamples.repeated(command, file)
    assert not counterexamples.fails(result, Benchmark("strict").rules)
    assert result.measurements.limit_cycle < 2e-6


ATTACKED = (
    "flexible-manipulator simulate SteadyLQG.fmu --protocol strict --system nominal --test delay_1 "
    "--configuration 56.6427 24.6453 --phi-F 0.8831 --chirp-frequencies 0.0 15.0 --t-3 0.5 --seed 7 "
    "--plant-set "
    "m[1]=55.00000000000001,m[2]=165.0,k_low[1]=600000.0,k_low[2]=240000.0,k_high[1]=1785900.0000000002,"
    "k_high[2]=240000.0,psi[1]=0.00046542113386515457,psi[2]=0.0010471975511965976,d[1]=480.0,d[2]=160.0,"
    "f_d[1]=0.0011999999999999997,f_d[2]=0.0020928,f_c[1]=0.29999999999999993,f_c[2]=1.8,"
    "mu_k[1]=0.27749999999999997,mu_k[2]=0.70125,beta[1]=0.6000000000000001,beta[2]=0.27999999999999997,"
    "alpha[1]=6.9575,alpha[2]=7.5,gamma[1]=1.1,gamma[2]=1.004"
)
"""An arm that an attack found for 2.2 ms: with the delay of A2 it is at rest, but not without the slow feedback."""


RETRIGGERED = (
    "flexible-manipulator simulate SteadyLQG.fmu --protocol strict --system nominal --test delay_2 "
    "--configuration -89.98 -179.98 --phi-F 3.8292906419829453 --chirp-frequencies 15.0 0.0 "
    "--t-3 0.2510159894033098 --seed 44 --plant-set "
    "m[1]=45.85650663108962,m[2]=165.0,k_low[1]=406506.2242557943,k_low[2]=187771.9717145252,"
    "k_high[1]=1200000.0,k_high[2]=243165.03866581066,psi[1]=0.0006540998089829414,psi[2]=0.0009602623124851558,"
    "d[1]=483.85665636248035,d[2]=160.0,f_d[1]=0.0011999999999999997,f_d[2]=0.0005999999999999998,"
    "f_c[1]=2.7,f_c[2]=0.7128786751659797,mu_k[1]=0.25,mu_k[2]=0.25,beta[1]=0.2508875066442489,"
    "beta[2]=0.6000000000000001,alpha[1]=7.5,alpha[2]=7.494908380646217,gamma[1]=1.1,gamma[2]=1.096513519947151"
)
"""The arm on which the end of each dither began the next one, every 4.6 s, while the threshold fell at once."""


@needs_compiler
def test_the_end_of_the_dither_does_not_begin_it_anew(file):
    figures = counterexamples.repeated(RETRIGGERED, file).measurements
    assert figures.recovery < 1.0 and figures.limit_cycle_at_end < 1e-6


FADED = (
    "flexible-manipulator simulate SteadyLQG.fmu --protocol strict --system nominal --test delay_2 "
    "--configuration 72.599 33.078900000000004 --phi-F 5.800800000000001 --chirp-frequencies 15.0 0.0 --t-3 0.9514 "
    "--seed 2 --plant-set "
    "m[1]=45.71,m[2]=135.0,k_low[1]=600000.0,k_low[2]=160000.0,k_high[1]=1200000.0,k_high[2]=331080.0,"
    "psi[1]=0.0006804456977108559,psi[2]=0.0008772024820523501,d[1]=720.0,d[2]=240.0,f_d[1]=0.0108,"
    "f_d[2]=0.0005999999999999998,f_c[1]=2.7,f_c[2]=1.8,mu_k[1]=0.7085,mu_k[2]=0.25225,"
    "beta[1]=0.5468000000000001,beta[2]=0.5898,alpha[1]=7.5,alpha[2]=7.49,gamma[1]=0.9762,gamma[2]=1.0998"
)
"""An arm on which the fade of each dither began the next one, while it raised neither what an event
nor what a ringing arm must pass."""


@needs_compiler
def test_the_fade_of_the_dither_does_not_begin_it_anew(file):
    rules = Benchmark("strict").rules
    lower, own = (counterexamples.repeated(FADED + more, file) for more in (" --set dithered=1", ""))
    assert counterexamples.fails(lower, rules) and lower.measurements.limit_cycle_at_end > 5e-5
    assert not counterexamples.fails(own, rules) and own.measurements.limit_cycle < 2e-6


@needs_compiler
def test_the_dither_does_not_begin_again_by_itself():
    """While its strength followed the estimate of the error, it faded before its time and began again."""
    found = lists()["restarted"]["B6"]
    late = [arm for arm in found if arm["value"] > 3.0 and arm["q_a"][1] != -90.0]
    _, results = counterexamples.simulated(Benchmark("strict"), Controller.built_in("SteadyLQG"), late, listed=False)
    assert len(results) == 6 and max(result.measurements.B6 for result in results) < 1.0


@needs_compiler
def test_without_the_slow_feedback_an_arm_is_in_a_cycle_in_the_drives_limits_and_with_it_at_rest(file):
    rules = Benchmark("strict").rules
    without, with_it = (counterexamples.repeated(ATTACKED + more, file) for more in (" --set overload=2.0", ""))
    assert counterexamples.fails(without, rules) and without.measurements.limit_cycle > 0.003
    assert without.measurements.limit_cycle_frequency == pytest.approx(26.0, abs=0.1)
    assert not counterexamples.fails(with_it, rules) and with_it.measurements.limit_cycle < 2e-6
    assert with_it.measurements.recovery < 1.0


@needs_compiler
def test_the_slow_feedback_makes_robust_lqg_rest_as_well(fmu_folder):
    (command,) = {claim.command for claim in claims() if claim.figure == "A2"}
    result = counterexamples.repeated(command + " --set overload=0.6", built("RobustLQG", fmu_folder))
    assert not counterexamples.fails(result, Benchmark("strict").rules) and result.measurements.limit_cycle < 2e-6


SAME_FORCE = """extends = "repeated"
name = "same_force"
[[tests]]
name = "disturbance"
systems = "performance"
draws = true
duration = 76.0
criteria = ["B5", "B6", "B7"]
requirements = ["A3"]
again = { period = 10.0, number = 6, turn_deg = 0.0 }
"""


@needs_compiler
def test_a_force_that_comes_again_is_answered_as_the_first(file, tmp_path):
    (tmp_path / "same.toml").write_text(SAME_FORCE, encoding="utf-8")
    bench = Benchmark(tmp_path / "same.toml", plant="native", workers=1)
    for case in bench.evaluate(Controller(file)).results.cases:
        figures = case.measurements
        assert figures.B6_first > 0.1 and figures.B6_later == pytest.approx(figures.B6_first, rel=0.05)
