"""Tuning: its objective, what it adds to that, which candidate it keeps, and what data files say of their origin."""

from __future__ import annotations

import functools
import io
import json
import math
from argparse import ArgumentTypeError
from dataclasses import replace
from types import SimpleNamespace

import pytest
from msgspec import structs
from rich.console import Console
from support.closed_loops import GRID
from support.refusals import refusal
from support.reports import swept, tuned
from support.tools import PRESENT
from test_pid import GAINS, STARTS

from benchmarks.tuning import friction, lqg, pid_tuned
from benchmarks.tuning import task as scripts
from orchestrator import Benchmark, Controller, InputError, Sweep
from orchestrator.cli import studies, values
from orchestrator.cli.finished import report
from orchestrator.documents.tuning import Tuning, failure_words, tuning_remarks
from orchestrator.loop.trajectory import Status
from orchestrator.search.candidates import NO_CYCLE, REFUSED, Trial, trial
from orchestrator.study import tuner
from orchestrator.study.requests import Tell, answered
from orchestrator.study.tuner import CandidateVerdict
from orchestrator.views.page import page_html
from orchestrator.views.terminal import show

pytestmark = pytest.mark.needs("optuna", "cmaes")

TASKS = {task.shipped: task for task in (pid_tuned.TASK, lqg.TASK, friction.TASK)}

FEW = """
extends = "paper"
name = "{name}"
[grid]
q_a1_points = 1
q_a2_points = 1
[sets]
performance = ["{system}"]
low_friction = ["slippery"]
[[tests]]
name = "noise"
systems = "performance"
duration = 1.0
disturbed = false
criteria = ["B1", "B2"]
[[tests]]
name = "disturbance"
systems = "performance"
duration = 13.0
criteria = ["B3", "B4", "B5", "B6", "B7"]
[[tests]]
name = "delay_2"
systems = "low_friction"
duration = 20.0
axis = 2
delay = "1.5e-3"
requirements = ["A2", "A3"]
"""
VARY = {"K_d[2]": (0.05, 1.2, "log"), "z_p[2]": (0.6, 0.99)}


@pytest.fixture
def short(tmp_path):
    """A protocol to judge by, and one to try candidates in."""
    files = []
    for name, system in (("whole", "nominal"), ("short", "compliant")):
        files.append(tmp_path / f"{name}.toml")
        files[-1].write_text(FEW.format(name=name, system=system))
    return Benchmark(files[0]), files[1]


def test_poses_of_the_objective_are_none_of_the_papers():
    poses = {(case.configuration.q_a1, case.configuration.q_a2) for case in Benchmark("tuning").cases}
    assert len(poses) == 6
    assert not poses & {(pose.q_a1, pose.q_a2) for pose in GRID}


def test_objective_is_the_cost_with_a_penalty_where_a_requirement_fails(quick):
    rules = quick.results.rules

    def with_cycles(amplitude, ratio):
        cycle = {"limit_cycle": amplitude, "limit_cycle_at_end": amplitude}
        cycle |= {"limit_cycle_ratio": ratio, "limit_cycle_decay": ratio}
        return [
            case
            if case.measurements.limit_cycle is None
            else structs.replace(case, status=Status.DONE, measurements=structs.replace(case.measurements, **cycle))
            for case in quick.cases
        ]

    def found(*cycle):
        return trial(rules, 0, {}, with_cycles(*cycle), whole=True)

    tests = sum(case.measurements.limit_cycle is not None for case in quick.cases)
    limit, ring_down = rules.stability.limit_cycle, rules.stability.ring_down
    assert tests > 10
    for holding in ((0.9 * limit, 1.0), (1e3 * limit, 0.99 * ring_down)):
        assert (found(*holding).objective, found(*holding).holds) == (quick.cost, True)
    assert found(math.e * limit, 1.0).objective == pytest.approx(quick.cost + (1.0 + 4.0) * tests)
    assert found(1e6 * limit, math.e**0.1 * ring_down).objective == pytest.approx(quick.cost + (1.0 + 4.0) * tests)
    assert found(None, None).objective == pytest.approx(quick.cost + NO_CYCLE * tests)
    assert not found(None, None).holds
    assert trial(rules, 0, {}, with_cycles(None, None), whole=False).objective == quick.cost, "a lower bound"
    died = [structs.replace(quick.cases[0], status=Status.CRASHED, message="it died\nat noon"), *quick.cases[1:]]
    assert (trial(rules, 0, {}, died, whole=True).objective, trial(rules, 0, {}, died, True).message) == (
        REFUSED,
        "it died",
    )


def test_a_failure_is_added_once_and_what_held_is_not_forgotten(monkeypatch):
    """All but the start fail in the same case, though their objectives are lower."""
    bench = Benchmark()
    case = bench.case("c07.slippery.delay_2")

    def judge(trial):
        return (
            CandidateVerdict(90.0, None, ("A2",), [(case, "")])
            if trial.number
            else CandidateVerdict(100.0, None, (), ())
        )
        yield

    def attempt(_protocol, _rules, _pairings, _cases, asked, _worst=math.inf):
        return [Trial(number, values, 100.0 - number, holds=True) for number, values in asked]
        yield

    proposals = SimpleNamespace(ask=lambda count: [{}] * min(count, 7), tell=lambda _: None)
    monkeypatch.setattr(tuner, "attempt", attempt)
    search = tuner.Tuner(bench.rules, lambda _: None, judge, proposals, list(bench.cases[:3]))
    run = functools.partial(answered, answer=lambda event: None)
    run(search.search(1))
    assert search.judged.keys() == {0}
    run(search.search(60))
    best = run(search.best())
    assert best is not None and best.number == 0
    assert len(search.judged) > 3
    (added,) = search.cases[3:]
    assert added.scenario == case.scenario
    assert search.rules.test(added.test.name).requirements == ("A2", "A3")


def test_the_best_so_far_is_the_best_in_the_cases_that_the_result_counts(monkeypatch):
    """With the case that the start fails in, every objective is higher: what was lower before is not told any more."""
    bench = Benchmark()
    case = bench.case("c07.slippery.delay_2")

    def judge(trial):
        return CandidateVerdict(90.0, None, ("A2",), [] if len(search.cases) > 3 else [(case, "")])
        yield

    def attempt(_protocol, _rules, _pairings, cases, asked, _worst=math.inf):
        return [Trial(number, values, 100.0 * (len(cases) - 2) - number) for number, values in asked]
        yield

    told = []
    proposals = SimpleNamespace(ask=lambda count: [{}] * min(count, 7), tell=lambda _: None)
    monkeypatch.setattr(tuner, "attempt", attempt)
    search = tuner.Tuner(bench.rules, lambda _: None, judge, proposals, list(bench.cases[:3]))
    answered(search.search(30), lambda request: told.append(request.event) if isinstance(request, Tell) else None)
    added = [event for event in told if event.done > 7]
    assert len(search.cases) == 4 and added[0].best.objective == 200.0 - 7
    assert all(event.best.objective == 200.0 - event.trial.number for event in added)
    lines = [studies._tell_candidates()(event) for event in (told[0], replace(told[0], best=None))]
    assert "best so far: objective 100" in lines[0] and "best" not in lines[1]


@pytest.mark.needs("compiler")  # with the PID in Python it takes minutes
@pytest.mark.slow
def test_a_search_finds_better_parameters_and_finds_them_again(short, pid_c_file, tmp_path):
    """Interrupted, it goes on with what is stored, and comes to the same answer; a broken candidate is one trial."""
    goal, objective = short
    controller = Controller(pid_c_file)
    told = []

    def interrupt(entry, done, total):
        told.append(entry)
        if done == 15:
            raise KeyboardInterrupt

    options = {"trials": 30, "objective": objective, "strict": objective, "folder": tmp_path / "first"}
    with pytest.raises(KeyboardInterrupt):
        goal.tune(controller, VARY, **options, on_trial=interrupt)
    first = goal.tune(controller, VARY, **options)
    other = goal.tune(controller, VARY, **{**options, "folder": tmp_path / "other"})
    assert first.trials == other.trials and first.best == other.best
    assert list(first.trials[: len(told)]) == told or any(each.commands for each in first.judged)
    assert [entry.number for entry in first.trials] == list(range(30))
    assert first.trials[0].values == {"K_d[2]": GAINS["K_d"][1], "z_p[2]": GAINS["z_p"][1]}
    best = first.best
    assert best is not None and best.trial.objective < first.trials[0].objective
    again = goal.evaluate(controller.with_parameters(first.parameters), recordings=False)
    assert again.cost == best.cost and all(entry.passed is not False for entry in again.requirements.values())
    assert Tuning.load(tmp_path / "first") == first
    assert Controller(controller.file, tmp_path / "first" / "best.toml").setup.parameters == first.parameters


def test_what_the_fmu_refuses_costs_a_trial(short):
    goal, objective = short
    controller = Controller.built_in("DitheredLQG_C" if PRESENT["compiler"] else "DitheredLQG")
    found = goal.tune(
        controller,
        {"effort[1]": (1e-12, 1.0, "log")},
        trials=4,
        objective=objective,
        strict=objective,
        sampler="random",
    )
    refused = [entry for entry in found.trials if entry.message]
    assert refused and all(entry.objective == REFUSED for entry in refused)
    assert len(found.trials) == 4


def test_a_protocol_that_has_no_v_is_refused(quick_pid_file):
    given = {"K_d[2]": (10.0, 60.0)}
    found = refusal(lambda: Benchmark().tune(Controller(quick_pid_file), given, trials=4, objective="repeated"))
    assert found.what == "no-criteria" and "does not measure B1, B2" in str(found)


def test_a_sweep_tries_every_combination(short, quick_pid_file, tmp_path):
    goal, objective = short
    controller, told = Controller(quick_pid_file), []
    given = {"K_d[2]": (GAINS["K_d"][1], 60.0), "z_p[2]": (0.9,)}
    found = goal.sweep(controller, given, objective=objective, folder=tmp_path, on_trial=lambda *now: told.append(now))
    assert [entry.values for entry in found.trials] == [{"K_d[2]": value, "z_p[2]": 0.9} for value in given["K_d[2]"]]
    assert told == [(entry, number, 2) for number, entry in enumerate(found.trials, start=1)]
    first, second = found.trials
    evaluation = replace(goal, protocol=objective).evaluate(controller.with_parameters(first.values), recordings=False)
    assert first.cost == evaluation.cost and first.holds and not second.holds
    assert Sweep.load(tmp_path) == found and found.best == first
    assert found.to_pandas().columns.tolist() == ["K_d[2]", "z_p[2]", "V", "cycle", "holds", "message"]
    assert first.values["K_d[2]"] in found.plot().axes[0].lines[0].get_xdata()


def test_a_sweep_is_a_line_a_map_or_a_table():
    line, chart, table = swept(4), swept(3, 1, 2), swept(2, 2, 2)
    drawn = {entry.get_label(): entry.get_xydata().tolist() for entry in line.plot().axes[0].lines}
    assert drawn["A1-A3 fail"][:2] == [[2.0, 91.0], [3.0, 92.0]] and "no V" in drawn
    axes = chart.plot().axes[0]
    assert (axes.get_xlabel(), axes.get_ylabel()) == ("K_2", "K_0")
    assert axes.images[0].get_array().tolist() == [[94.0, None], [92.0, 93.0], [90.0, 91.0]], "upwards"
    assert [entry.get_text() for entry in axes.texts] == [*("94\n×", "-\n×", "92\n×", "93\n×"), "90", "91\n×"]
    assert refusal(table.plot).what == "no-picture"
    assert "&lt;i&gt;" in table._repr_html_() and table.csv().endswith(",,,False,'=died <i>at noon</i>\n")
    assert values.grid_values("K=1:100:3:log") == ("K", (1.0, 10.0, 100.0))
    assert values.grid_values("K[1]=3,2") == ("K[1]", (3.0, 2.0))
    for wrong in ("K", "K=1:2", "K=0:1:3:log", "K=1:2:1", "=1,2", "K=1,2:log"):
        with pytest.raises(ArgumentTypeError):
            values.grid_values(wrong)
    for wrong, told in {"K=1:2:99999": "from 2 to 10000", "K=2:1:3": "the first must be the smaller one"}.items():
        with pytest.raises(ArgumentTypeError, match=told):
            values.grid_values(wrong)


def test_report_shows_a_tuning_or_a_sweep_again(tmp_path, capsys):
    tuned().save(tmp_path / "tuning")
    swept(4).save(tmp_path / "sweep")
    assert report([str(tmp_path / "tuning")]) == report([str(tmp_path / "sweep"), "--json"]) == 0
    printed = capsys.readouterr().out
    assert "Parameters" in printed and '"flexible-manipulator-sweep/' in printed
    names = ({"tuning.json", "report.html"}, {"sweep.json", "sweep.csv", "sweep.svg", "report.html"})
    assert [{file.name for file in (tmp_path / kind).iterdir()} for kind in ("tuning", "sweep")] == list(names)


def test_a_trial_says_which_requirement_fails_and_by_how_much(quick):
    rules = quick.results.rules
    limit = rules.stability.limit_cycle

    def found(amplitude):
        cycle = {"limit_cycle": amplitude, "limit_cycle_at_end": amplitude}
        cycle |= {"limit_cycle_ratio": 1.0, "limit_cycle_decay": 1.0}
        cases = [
            structs.replace(case, status=Status.DONE, measurements=structs.replace(case.measurements, **cycle))
            if rules.test(case.test).requirements == ("A2", "A3")
            else case
            for case in quick.cases
        ]
        return trial(rules, 0, {}, cases, whole=True)

    assert found(0.5 * limit).fails == {} and failure_words(found(0.5 * limit)) == ""
    assert found(1.5 * limit).fails == {"A2": pytest.approx(1.5), "A3": pytest.approx(1.5)}
    assert failure_words(found(1.5 * limit)) == "A2 (1.5 times the limit), A3 (1.5 times the limit)"
    assert failure_words(found(None)) == "A2 (unstable), A3 (unstable)"


def printed(document):
    console = Console(file=io.StringIO(), emoji=False, width=200)
    show(document.summary(), console)
    return console.file.getvalue()


def test_without_a_candidate_that_holds_the_nearest_is_told_with_what_failed(tmp_path):
    known = tuned()
    trials = [structs.replace(each, holds=False, fails={"A3": 1.75}) for each in known.trials]
    judged = [structs.replace(each, broken=("A2",), reasons=("A2 not met in paper: why",)) for each in known.judged]
    found = structs.replace(known, best=None, trials=tuple(trials), judged=tuple(judged))
    (first, nearest) = tuning_remarks(found)
    assert "None of the 2 candidates" in first
    assert (
        nearest == "Nearest: trial 20, objective 91, V = 91. It fails in tuning: A3 (1.75 times the limit). "
        "A2 not met in paper: why."
    )
    for shown in (printed(found), page_html(found.page()), found._repr_html_()):
        assert "Nearest to holding A1 to A3" in shown and "Nearest: trial 20" in shown
    found.save(tmp_path)
    assert Tuning.load(tmp_path) == found
    assert not found.rank.holds and found.V is None


@pytest.mark.parametrize(
    ("vary", "options", "what"),
    [
        ({}, {}, "nothing-varies"),
        ({"K_x": (1.0, 2.0)}, {}, "no-parameter"),
        ({"u_m0[1]": (0.0, 1.0)}, {}, "connector-parameter"),
        ({"K_p[1]": (2.0, 1.0)}, {}, "bad-range"),
        ({"K_p[1]": (0.0, 1.0, "log")}, {}, "bad-range"),
        (VARY, {"sampler": "oracle"}, "bad-option"),
        (VARY, {"trials": 0}, "bad-number"),
    ],
)
def test_what_cannot_be_searched_is_refused(vary, options, what):
    with pytest.raises(InputError) as problem:
        Benchmark().tune(Controller(), vary, **options)
    assert problem.value.what == what


@pytest.mark.parametrize("name", TASKS)
def test_data_file_says_what_made_it(name, tmp_path):
    """Either the tuning of an earlier version, which is gone, or the script with all that is its own, as it is now."""
    task = TASKS[name]
    tuned = json.loads(task.file.read_text(encoding="utf-8"))["tuned"]
    assert tuned.get("made_by") == "the tuning of version 0.1.0" or scripts.origin(task.script).items() <= tuned.items()
    written = replace(task, file=tmp_path / "data.json")
    written.file.write_bytes(task.file.read_bytes())
    first = next(iter(task.start))
    scripts.write(written, {first: 1.5}, {"trials": 3})
    contents = json.loads(written.file.read_text(encoding="utf-8"))
    assert contents["tuned"] == {**scripts.origin(task.script), "trials": 3}
    assert contents["parameters"] == {**STARTS[name], first: 1.5}
    assert task.start.keys() <= STARTS[name].keys(), "what is tuned is in the file"
    assert all(low < task.start[each] < high for each, (low, high, _) in task.vary().items())
