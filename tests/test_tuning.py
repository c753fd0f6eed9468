"""The tuning: its simulator, and which candidate of a search is kept."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from closed_loops import case, simulate_all
from numpy.testing import assert_allclose
from pid_fmus import GAINS as PAPERS_GAINS

import build_fmus
from controller_fmu.friction import tune as friction
from controller_fmu.lqg import flexible_manipulator_lqg as lqg
from controller_fmu.lqg import tune as plain
from controller_fmu.pid_tuned import tune as pid
from controller_fmu.tuning import problem
from controller_fmu.tuning.search import Task, finalist
from orchestrator.errors import BenchmarkError


def test_simulator_is_the_benchmarks_loop(plant_file, fmu_folder):
    chosen = case(4, "compliant", "delay_2")
    scenario = replace(chosen.scenario, duration=chosen.scenario.duration / 13)
    chosen = replace(chosen, scenario=scenario)
    (expected,) = simulate_all(plant_file, build_fmus.build("DitheredLQG", fmu_folder), [scenario])
    at = problem.experiment(chosen)
    law = plain.law_of(lqg.read_weights(friction.WEIGHTS), friction.read_dither(friction.WEIGHTS))
    X, torque = problem.trajectory(at, law(at.q_m_ref, at.u_m0))
    assert_allclose(torque, expected.torque, atol=0.03)
    assert_allclose(X, expected.X, atol=1e-6)
    assert math.isclose(np.max(np.abs(torque)), np.max(np.abs(expected.torque)), abs_tol=0.03)


FINGERPRINT = """
import hashlib
from controller_fmu.friction import tune
from controller_fmu.lqg import flexible_manipulator_lqg as lqg
from controller_fmu.lqg.tune import law_of
from controller_fmu.pid_tuned import tune as pid
from controller_fmu.tuning import problem
from controller_fmu.tuning.search import Task, finalist
from orchestrator.errors import BenchmarkError

poses, tests = problem.scattered_poses(1, 3), ["disturbance"]
(at,) = problem.experiments(poses, tests, {"performance": ["compliant"]}, 3, shortened=True)
law = law_of(lqg.read_weights(tune.WEIGHTS), tune.read_dither(tune.WEIGHTS))(at.q_m_ref, at.u_m0)
print(hashlib.sha256(problem.trajectory(at, law)[0].tobytes()).hexdigest())
"""


def test_simulator_gives_the_same_bits_compiled_and_from_the_cache(tmp_path):
    """One bit moves a quantized, dithered loop, and with it the result of a search."""
    caches = {"FLEXIBLE_MANIPULATOR_CACHE": str(tmp_path / "ours"), "NUMBA_CACHE_DIR": str(tmp_path / "plant")}
    first, second = (
        subprocess.run(
            [sys.executable, "-c", FINGERPRINT],
            cwd=Path(build_fmus.__file__).parent,
            env={**os.environ, **caches},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for _ in range(2)
    )
    assert len(first.strip()) == 64 and first == second


GAINS = json.loads(pid.GAINS.read_text(encoding="utf-8"))["gains"]
TUNED = {f"{name}[{axis}]": pair[axis - 1] for name, pair in GAINS.items() for axis in (1, 2)}
PAPERS = {f"{name}[{axis}]": pair[axis - 1] for name, pair in PAPERS_GAINS.items() for axis in (1, 2)}


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
