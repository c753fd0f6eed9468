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

needs_compiler = pytest.mark.needs("compiler")

ENDLESS = {"dither_time": math.inf, "spent": 1.0, "sway": math.inf, "sway_share": 0.0}
ENDLESS |= {"peak_time": math.inf, "peak_regain": 0.0}
"""What SteadyLQG leaves out of RobustLQG, as if it were not there."""

OWN = {"headroom", "threshold", "contrast", "dithered"}
"""Parameters with other values than those of RobustLQG."""


@pytest.fixture(scope="module")
def file(fmu_folder):
    return built("SteadyLQG", fmu_folder)


def test_it_has_the_parameters_of_robust_lqg_without_the_limits_and_the_weights_of_its_laws():
    assert {row.name for row in ROBUST_ROWS} - {row.name for row in ROWS} == set(LEFT_OUT)
    own, robust = (
        json.loads((build_fmus.HERE / "controller_fmu" / name).read_text(encoding="utf-8"))["parameters"]
        for name in ("steady_c/steady_weights.json", "robust_c/robust_weights.json")
    )
    assert {name for name, value in robust.items() if own.get(name) != value} == OWN | set(LEFT_OUT)


@needs_compiler
@pytest.mark.slow
def test_torques_are_those_of_the_law(file):
    signals, starts = signals_of(file)
    # So low a threshold that the third law begins several times.
    changed = {"jump": 1e-4, "jump_contrast": 1.5}
    expected = reference(signals, {**starts, **ENDLESS, **changed}, prolongs=False)
    assert np.count_nonzero(np.diff(expected.peak) > 0.5) > 2
    assert (expected.event == 0).mean() > 0.3 and (expected.event == 1).any() and (expected.dither > 0).any()
    found = in_child(torques, file, signals, changed)
    drive = TORQUE_LIMIT / 2**11
    assert_allclose(found / drive, expected.u_m / drive, rtol=0.0, atol=0.05)


@needs_compiler
def test_the_arm_on_which_robust_lqg_fails_a2_comes_to_rest(file):
    (command,) = {claim.command for claim in claims() if claim.figure == "A2"}
    result = counterexamples.repeated(command, file)
    assert not counterexamples.fails(result, Benchmark("strict").rules)
    assert result.measurements.limit_cycle < 2e-6


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
