"""A broken controller is told in seconds: after failures of one kind, or after its first sample."""

from __future__ import annotations

import csv
import sys
from dataclasses import replace

import pytest
from hostile import fmus
from hostile.commands import command, finished
from hostile.fmus import Fault
from hostile.runs import PROTOCOL, SPARED, STRUCK, bench, run, short_cases

from orchestrator.cosim.trace import CONTROLLER, Place
from orchestrator.cosim.trajectory import Status
from orchestrator.errors import FmuError
from orchestrator.execution import cluster, evaluation, isolation
from orchestrator.execution.evaluation import rehearse
from orchestrator.execution.job import Died, Failed, Finished, Limits

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the corpus is written for Linux")

CRASHED, TIMEOUT, ERROR, DONE = Status.CRASHED, Status.TIMEOUT, Status.ERROR, Status.DONE

HANG_LIMIT = 1.2
"""Wall time [s] for a case that hangs; all others have plenty."""
ONLY_STRUCK = -float(STRUCK) * 1e3


@pytest.fixture(autouse=True)
def no_slack(monkeypatch):
    """Time limits in proportion to the simulated time alone, and what comes on top of them short."""
    monkeypatch.setattr(evaluation, "START_TIME", 0.0)
    monkeypatch.setattr(isolation, "GRACE", 0.3)


# ---- Three strikes ----


def test_a_broken_controller_answers_after_three_crashes(plant_file, faulty):
    own = bench(plant_file, faulty(Fault("abort")))
    cases = short_cases(own.plant, (STRUCK,) * 4 + (SPARED,) * 4)
    results = run(own, cases, keep_going=False)
    assert [result.status for result in results] == [CRASHED] * 3 + [Status.SKIPPED] * 5
    assert "skipped after 3 failures of one kind (crashed: the process was ended by SIGABRT" in results[3].message
    assert "--keep-going" in results[3].message
    assert [result.status for result in run(own, cases)] == [CRASHED] * 8


def test_the_command_tells_how_it_failed_and_goes_on(faulty, tmp_path):
    file = faulty(Fault("abort"))
    done = finished(command(tmp_path, str(file), "--quick"))
    assert done.returncode == 1
    with (tmp_path / "cases.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [row["status"] for row in rows].count("skipped") >= 24 - 3 - 2  # two processes may be at work at the third
    crashed = [row for row in rows if row["status"] == "crashed"]
    assert len(crashed) >= 3
    for row in crashed:
        assert row["time [s]"] == "0.02"
        assert "SIGABRT, in the call 'fmi2DoStep' of the controller at t = 0.02 s" in row["message"]


def test_strikes_of_an_earlier_run_count(plant_file, faulty):
    own = bench(plant_file, faulty(Fault("abort")))
    cases = short_cases(own.plant, (STRUCK,) * 4)
    earlier = run(own, cases[:3])

    def never(jobs):
        raise AssertionError("nothing is to be run")

    found = list(evaluation.evaluate(PROTOCOL, cases[3:], own, never, earlier))
    assert [result.status for result in found] == [Status.SKIPPED]


KIND = {
    "grow": ("it used too much memory", Limits(memory=400_000_000)),
    "print": ("it printed or logged too much", Limits(output=1_000_000)),
    "garbage": ("it wrote into a pipe that is not its own", Limits()),
    "exit:3": ("the process ended by itself with exit code 3", Limits()),
    "spin": ("the time limit was reached", Limits()),
}


@pytest.mark.parametrize("what", KIND)
def test_the_kind_of_a_failure_has_nothing_that_was_measured(what, plant_file, faulty):
    kind, limits = KIND[what]
    own = bench(plant_file, faulty(Fault(what)), HANG_LIMIT if what == "spin" else 10.0, limits=limits)
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert result.kind == kind


def measured(number: int, index: int):
    """Failures that differ in what was measured."""
    place, told = Place(number, CONTROLLER, ("set", "step", "get")[number % 3]), "it used too much memory"
    error = {"status": ERROR, "time": 0.1 * number, "message": f"x.fmu: fmi2DoStep returned error\n  {number}"}
    return {
        "died": Died(index, False, f"it used {2.0 + number} GB of memory", told, 1.0, place),
        "failed": Failed(index, FmuError(f"x.fmu: reading {number:#x}", "instantiation"), 1.0),
        "finished": Finished(index, error, 1.0),
    }


@pytest.mark.parametrize("how", ["died", "failed", "finished"])
def test_failures_that_differ_in_what_was_measured_are_of_one_kind(how, plant_file, faulty):
    own = bench(plant_file, faulty(fmus.NONE))
    cases = short_cases(own.plant, (STRUCK,) * 4)

    def execute(jobs):
        for index in range(4):
            yield 0, measured(index, index)[how]

    found = list(evaluation.evaluate(PROTOCOL, cases, own, execute))
    assert [result.status for result in found[:3]] == [found[0].status] * 3
    assert found[3].status is Status.SKIPPED
    assert found[0].kind in found[3].message


def test_a_worker_that_was_lost_is_no_failure_of_the_controller(plant_file, faulty):
    own = bench(plant_file, faulty(fmus.NONE))
    cases = short_cases(own.plant, (STRUCK,) * 4)
    lost = [cluster._lost(index, "a worker") for index in range(4)]
    found = list(evaluation.evaluate(PROTOCOL, cases, own, lambda jobs: ((0, outcome) for outcome in lost)))
    assert [(result.status, result.final) for result in found] == [(CRASHED, False)] * 4


@pytest.mark.parametrize(("what", "status"), [("status:3", DONE), ("abort", CRASHED)])
def test_what_goes_wrong_at_the_end_has_the_time_of_the_end(what, status, plant_file, faulty):
    own = bench(plant_file, faulty(Fault(what, "terminate", 0.0)))
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert (result.status, result.time) == (status, float(STRUCK))


def test_a_hang_on_the_way_is_waited_for_once(plant_file, faulty, monkeypatch):
    """What ran before in the process may keep the next case from starting; a hang on the way is the case's own."""
    starts = []
    started = isolation.started
    monkeypatch.setattr(isolation, "started", lambda job, stop: starts.append(job) or started(job, stop))
    own = bench(plant_file, faulty(Fault("spin", "step", 0.02, ONLY_STRUCK)), HANG_LIMIT)
    results = run(own, short_cases(own.plant, (SPARED, STRUCK)))
    assert [result.status for result in results] == [DONE, TIMEOUT]
    assert len(starts) == 1


# ---- The rehearsal ----


@pytest.fixture
def short_start(monkeypatch):
    """A rehearsal that waits as long as a short case does."""
    monkeypatch.setattr(evaluation, "FIRST_START_TIME", HANG_LIMIT)


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [
        (Fault("segfault", "step", 0.0), CRASHED, ("SIGSEGV, in the call 'fmi2DoStep'", "to follow a bad pointer")),
        (Fault("segfault", "initialize", 0.0), CRASHED, ("SIGSEGV, in the call 'enterInitializationMode'",)),
        (Fault("spin", "step", 0.0), TIMEOUT, ("the time limit was reached, in the call 'fmi2DoStep'",)),
        (Fault("spin", "instantiate", 0.0), TIMEOUT, ("in the call 'instantiation' of the controller",)),
    ],
    ids=str,
)
def test_a_failure_in_the_first_sample_is_told_at_once(fault, status, words, plant_file, faulty, short_start):
    own = replace(bench(plant_file, faulty(fault)), timeout=2.0)
    cases = short_cases(own.plant, (STRUCK,) * 4)
    failure = rehearse(cases[0], own).failure
    assert failure is not None and (failure.case, failure.status, failure.time) == (cases[0], status, 0.0)
    for word in words:
        assert word in failure.message

    def never(jobs):
        raise AssertionError("nothing is to be run")

    found = list(evaluation.evaluate(PROTOCOL, cases, own, never, at_once=failure))
    assert found[0] == failure
    assert [(result.case, result.status) for result in found[1:]] == [(case, Status.SKIPPED) for case in cases[1:]]
    assert f"a failure in the first sample ({status.value}: {failure.kind}); --keep-going" in found[1].message
    again = list(evaluation.evaluate(PROTOCOL, cases[1:], own, never, [failure], at_once=failure))
    assert again == found[1:]  # a run that was interrupted after the first result


@pytest.mark.parametrize(
    "fault",
    [
        Fault("abort", "step", 0.02),
        Fault("abort", "terminate", 0.0),
        Fault("segfault", "initialize", 0.0, which=2),
        Fault("kill:9", "step", 0.0),
    ],
    ids=str,
)
def test_what_does_not_show_in_the_first_sample_is_left_to_the_cases(fault, plant_file, faulty):
    own = bench(plant_file, faulty(fault))
    assert rehearse(short_cases(own.plant, (STRUCK,))[0], own).failure is None


def test_the_rehearsal_gives_those_more_time_whose_cases_have_more(plant_file, faulty, short_start):
    own = bench(plant_file, faulty(fmus.NONE))
    patient = replace(own, timeout=240.0)
    limits = []

    def note(job):
        limits.append(job.time_limits)
        return iter(())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "run_isolated", note)
        rehearse(short_cases(own.plant, (STRUCK,))[0], patient)
    assert limits[0][0] == pytest.approx(120.0, abs=0.01)


def test_keep_going_runs_all_and_what_failed_again(faulty, tmp_path):
    file = str(faulty(Fault("abort", "step", 0.0)))
    options = ("--quick", "--only", "c00.*")
    tables = []
    for more in ((), ("--keep-going",), ("--keep-going",), ()):
        done = finished(command(tmp_path, file, *options, *more))
        assert done.returncode == 1
        assert ("earlier run (--force runs anew, --keep-going what failed)" in done.stderr) == (len(tables) == 3)
        with (tmp_path / "cases.csv").open() as table:
            tables.append([row["status"] for row in csv.DictReader(table)])
    assert tables[0] == ["crashed"] + ["skipped"] * (len(tables[0]) - 1)
    assert tables[1] == tables[2] == tables[3] == ["crashed"] * len(tables[0])
