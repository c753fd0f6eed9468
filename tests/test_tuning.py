"""The tuning: its objective, which candidate of a search is kept, and what data files say of their origin."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import pytest
from msgspec import structs
from support.closed_loops import GRID
from test_pid import GAINS, STARTS

import build_fmus
from controller_fmu.friction import tune as friction
from controller_fmu.lqg import tune as lqg
from controller_fmu.pid_tuned import tune as pid
from controller_fmu.tuning import search
from orchestrator import Benchmark, BenchmarkError, Evaluation
from orchestrator.benchmark.results import Measurements

TASKS = {task.shipped: task for task in (pid.TASK, lqg.TASK, friction.TASK)}
TUNED = STARTS["TunedPID"]
PAPERS = {f"{name}[{axis}]": pair[axis - 1] for name, pair in GAINS.items() for axis in (1, 2)}


def test_poses_of_the_search_are_none_of_the_protocols():
    poses = {(case.configuration.q_a1, case.configuration.q_a2) for case in Benchmark(search.PROTOCOL).cases}
    assert len(poses) == 6
    assert not poses & {(pose.q_a1, pose.q_a2) for pose in GRID}


def test_objective_is_the_cost_with_a_penalty_for_limit_cycles(quick):
    def with_cycles(amplitude):
        cases = tuple(
            case
            if case.measurements.limit_cycle is None
            else structs.replace(case, measurements=Measurements(limit_cycle_x=amplitude, limit_cycle_z=0.0))
            for case in quick.cases
        )
        return Evaluation(structs.replace(quick.results, cases=cases))

    stability_tests = sum(case.measurements.limit_cycle is not None for case in quick.cases)
    assert stability_tests > 10
    assert search.objective(with_cycles(9e-6)) == quick.cost
    assert search.objective(with_cycles(math.e * 10e-6)) == pytest.approx(quick.cost + 4.0 * stability_tests)
    assert search.objective(with_cycles(None)) == quick.cost + 100.0 * stability_tests


def test_a_candidate_beyond_a_limit_is_not_simulated(monkeypatch):
    monkeypatch.setattr(Benchmark, "evaluate", lambda *_, **__: pytest.fail("simulated"))
    task = replace(pid.TASK, start={**pid.START, "z_p[2]": 0.995})
    assert search.objective_of(task)([0.0] * len(pid.START)) > search.REFUSED


@pytest.mark.skipif(build_fmus.find_compiler() is None, reason="no C compiler")
def test_a_candidate_that_the_fmu_refuses_has_no_cost():
    task = replace(lqg.TASK, start={**lqg.START, "effort[1]": 1e-12})
    assert search.objective_of(task)([0.0] * len(lqg.START)) == search.REFUSED


@pytest.mark.slow
def test_the_best_candidate_that_holds_a1_to_a3_is_kept(capsys):
    """The paper's PID fails A2 in its worst configuration, whatever a search's few tests made of it."""
    task, only = replace(pid.TASK, start=TUNED), ("c07.slippery.gain_*", "c07.slippery.delay_*")
    papers = (1.0, tuple(math.log(PAPERS[name] / TUNED[name]) for name in TUNED))
    tuned = (2.0, (0.0,) * len(TUNED))
    assert search.finalist(task, [tuned, papers], only) == (2.0, TUNED)
    first, second = capsys.readouterr().out.splitlines()
    assert first.startswith("1.00: Evaluation(") and "A2 fails" in first
    assert second.startswith("2.00: Evaluation(") and "A2 holds" in second
    with pytest.raises(BenchmarkError, match="None of the 1 best candidates .* holds A1-A3"):
        search.finalist(task, [papers], only)


@pytest.mark.parametrize("name", TASKS)
def test_data_file_says_what_made_it(name, tmp_path):
    """Either the tuning of an earlier version, which is gone, or the script with all that is its own, as it is now."""
    task = TASKS[name]
    tuned = json.loads(task.file.read_text(encoding="utf-8"))["tuned"]
    assert tuned.get("made_by") == "the tuning of version 0.1.0" or search.origin(task.script).items() <= tuned.items()
    written = replace(task, file=tmp_path / "data.json")
    written.file.write_bytes(task.file.read_bytes())
    first = next(iter(task.start))
    search.write(written, {first: 1.5}, {"evaluations": 3})
    contents = json.loads(written.file.read_text(encoding="utf-8"))
    assert contents["tuned"] == {**search.origin(task.script), "evaluations": 3}
    assert contents["parameters"] == {**STARTS[name], first: 1.5}
    assert task.start.keys() <= STARTS[name].keys(), "what is tuned is in the file"
