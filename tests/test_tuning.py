"""The tuning: its simulator, and which candidate of a search is kept."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from support.closed_loops import case, simulate_all
from support.pid_fmus import built, in_child
from test_pid import PIDS

from controller_fmu.friction import tune as friction
from controller_fmu.lqg import flexible_manipulator_lqg as lqg
from controller_fmu.lqg import tune as plain
from controller_fmu.pid_tuned import tune as pid
from controller_fmu.tuning import problem
from controller_fmu.tuning.search import Task, finalist
from orchestrator.errors import BenchmarkError

CASE = case(4, "compliant", "delay_2")
AT = problem.experiment(replace(CASE, scenario=replace(CASE.scenario, duration=CASE.scenario.duration / 13)))
WITH_DITHER = plain.law_of(lqg.read_weights(friction.WEIGHTS), friction.read_dither(friction.WEIGHTS))


def simulated() -> tuple[np.ndarray, np.ndarray]:
    """Positions and torques as the tuning simulates a loop with a dither."""
    return problem.trajectory(AT, WITH_DITHER(AT.q_m_ref, AT.u_m0))


def test_simulator_is_the_benchmarks_loop(plant_file, fmu_folder):
    (expected,) = simulate_all(plant_file, built("DitheredLQG", fmu_folder), [AT.case.scenario])
    X, torque = simulated()
    assert_allclose(torque, expected.torque, atol=0.03)
    assert_allclose(X, expected.X, atol=1e-6)


def test_simulator_gives_the_same_bits_in_another_process():
    """Compiled here, in a fresh checkout, and taken from the cache there.

    One bit moves a quantized, dithered loop, and with it the result of a search.
    """
    for here, there in zip(simulated(), in_child(simulated), strict=True):
        np.testing.assert_array_equal(here, there)


TUNED = {f"{name}[{axis}]": pair[axis - 1] for name, pair in PIDS["TunedPID"].items() for axis in (1, 2)}
PAPERS = {f"{name}[{axis}]": pair[axis - 1] for name, pair in PIDS["DiagonalPID"].items() for axis in (1, 2)}


def test_the_best_candidate_that_holds_a1_to_a3_is_kept(capsys):
    """The paper's PID fails A2 in its worst configuration, whatever a search's few tests made of it."""
    names = ("gain_1", "gain_2", "delay_1", "delay_2")
    stability_tests = [problem.experiment(case(7, "slippery", name)) for name in names]
    task = Task(TUNED, lambda values: pid.law_of(pid.gains(values)))
    papers = (1.0, tuple(math.log(PAPERS[name] / TUNED[name]) for name in TUNED))
    tuned = (2.0, (0.0,) * len(TUNED))
    assert finalist(task, [tuned, papers], stability_tests) == (2.0, TUNED)
    assert "1.00 does not hold A2: c07.slippery.delay_2" in capsys.readouterr().out
    with pytest.raises(BenchmarkError, match="None of the 1 best candidates .* holds A1-A3"):
        finalist(task, [papers], stability_tests)
