"""A broken controller is told in seconds: after failures of one kind, or after its first sample."""

import functools
import random
from dataclasses import replace

import pytest
from hostile.fmus import Fault
from hostile.runs import HANG_LIMIT, PROTOCOL, SPARED, STRUCK, answered, bench, noise_cases, run, short_cases
from msgspec import structs

from orchestrator import Benchmark, Controller
from orchestrator.benchmark.results import Judgement
from orchestrator.codec import unpack
from orchestrator.execution import cluster, pool, store, supervision
from orchestrator.execution.job import MANY_LOGGED, Died, Done
from orchestrator.execution.messages import ErrorRecord, Failed
from orchestrator.fmi.trace import CONTROLLER, Place
from orchestrator.loop.trajectory import Status
from orchestrator.pairing.pairing import judge_job
from orchestrator.pairing.work import CaseTask
from orchestrator.study import rehearsal

pytestmark = [
    pytest.mark.needs("linux"),
    pytest.mark.usefixtures("no_slack"),
]

CRASHED, TIMEOUT, ERROR, DONE = Status.CRASHED, Status.TIMEOUT, Status.ERROR, Status.DONE
LOST, SKIPPED, UNSTABLE = Status.LOST, Status.SKIPPED, Status.UNSTABLE


def never(jobs):
    """Runs nothing, and must not be asked to."""
    raise AssertionError("nothing is to be run")


def statuses(runs) -> list[Status]:
    """What runs came to."""
    return [run.result.status for run in runs]


def test_a_broken_controller_answers_after_three_crashes(plant_file, faulty):
    own = bench(plant_file, faulty(Fault("abort")))
    cases = short_cases((STRUCK,) * 4 + (SPARED,) * 2)
    runs = run(own, cases, keep_going=False)
    assert statuses(runs) == [CRASHED] * 3 + [SKIPPED] * 3
    assert "crashed: the process was ended by SIGABRT" in runs[3].result.message
    assert statuses(run(own, cases)) == [CRASHED] * 6
    with store.opened(None) as known:
        answered(own, cases[:3], functools.partial(pool.run, workers=1), known=known)
        earlier = answered(own, cases, never, known=known)
    assert statuses(earlier[3:]) == [SKIPPED] * 3  # strikes of an earlier run count


MEASURED = {
    "died": lambda n: Died(n, False, f"it used {n} GB", "it used too much memory", 1.0, Place(n, CONTROLLER, "step")),
    "refused": lambda n: Failed(n, ErrorRecord("fmu", f"x.fmu: reading {n:#x}", call="instantiation"), 1.0),
    "done": lambda n: Done(n, Judgement(status=ERROR, time=0.1 * n, message=f"x.fmu: doStep failed\n  {n}"), 1.0),
}


@pytest.mark.parametrize("how", MEASURED)
def test_failures_that_differ_in_what_was_measured_are_of_one_kind(how, harmless):
    runs = ran(harmless, *map(MEASURED[how], range(4)))
    assert len({run.kind for run in runs[:3]}) == 1 and runs[0].kind
    assert statuses(runs)[3] is SKIPPED and runs[0].kind in runs[3].result.message


def test_two_timeouts_are_enough(harmless):
    """Each costs a whole time limit."""
    hangs = [Died(n, True, "it waited", "the limit of waiting", 1.0, Place(n, CONTROLLER, "step")) for n in range(4)]
    runs = ran(harmless, *hangs)
    assert statuses(runs) == [TIMEOUT, TIMEOUT, SKIPPED, SKIPPED]
    assert runs[3].result.message == "skipped after 2 failures of one kind (timeout: the limit of waiting)"
    others = (Done(n, Judgement(status=DONE, time=float(STRUCK)), 1.0) for n in range(1, 4))
    assert statuses(ran(harmless, hangs[0], *others)) == [TIMEOUT, DONE, DONE, DONE]


EVERY = 5
"""One case of so many comes to an end, from the first one on."""

ENDED_OR_SKIPPED = [UNSTABLE] + [ERROR] * 3 + [SKIPPED] * 20
"""What 24 such cases come to."""


def failing(jobs, cases, arranged):
    """The outcomes of all of ``jobs`` in the order that ``arranged`` makes of that of the ``cases``: each fails, but
    one of :data:`EVERY`."""
    numbers = {case.id: number for number, case in enumerate(cases)}
    places = {
        numbers[unpack(task, CaseTask).case.id]: (number_of_job, index)
        for number_of_job, job in enumerate(jobs)
        for index, task in enumerate(job.tasks)
    }
    for number in arranged(sorted(places)):
        failed = number % EVERY != 0
        judgement = Judgement(status=ERROR if failed else UNSTABLE, time=0.1, message="doStep failed" if failed else "")
        number_of_job, index = places[number]
        yield number_of_job, Done(index, judgement, 1.0)


def backwards(numbers):
    """The last one first."""
    return numbers[::-1]


def mixed(seed):
    """An order by chance."""
    return lambda numbers: random.Random(seed).sample(numbers, len(numbers))


@pytest.mark.parametrize("arranged", [list, backwards, *map(mixed, range(6))])
def test_what_is_skipped_follows_from_the_order_of_the_cases(arranged, harmless):
    """Failures counted as they arrived gave exit codes 3, 1, 3 and 1 in four runs of one FMU."""
    cases = noise_cases()[: len(ENDED_OR_SKIPPED)]
    runs = answered(harmless, cases, lambda jobs: failing(jobs, cases, arranged))
    assert statuses(runs) == ENDED_OR_SKIPPED
    told = "skipped after 3 failures of one kind (error: doStep failed)"
    assert {run.result.message for run in runs if run.result.status is SKIPPED} == {told}


def test_what_is_finished_behind_the_last_failure_is_stored(harmless):
    cases = noise_cases()[: len(ENDED_OR_SKIPPED)]
    with store.opened(None) as known:
        found = answered(harmless, cases, lambda jobs: failing(jobs, cases, backwards), known=known)
        again = answered(harmless, cases, never, known=known)
        assert statuses(again) == statuses(found) == ENDED_OR_SKIPPED
        waiting = []
        answered(harmless, cases, lambda jobs: failing(waiting.extend(jobs) or jobs, cases, list), True, known=known)
    wanted = {unpack(task, CaseTask).case.id for job in waiting for task in job.tasks}
    assert wanted == {
        case.id for number, case in enumerate(cases) if number % EVERY
    }  # the others had come to their end


def test_a_worker_that_was_lost_is_no_failure_of_the_controller(harmless):
    lost = ran(harmless, *(cluster._lost(index, "a worker") for index in range(4)))
    assert statuses(lost) == [LOST] * 4 and not any(run.result.judged for run in lost)


def ran(own, *outcomes):
    """The runs of four cases that end so."""
    ends = iter(outcomes)

    def execute(jobs):
        places = [(number, index) for number, job in enumerate(jobs) for index in range(len(job.tasks))]
        for (number, index), outcome in zip(places, ends, strict=False):
            yield number, structs.replace(outcome, index=index)

    return answered(own, short_cases((STRUCK,) * 4), execute)


@pytest.mark.parametrize(("what", "status"), [("status:3", DONE), ("abort", CRASHED)])
def test_what_goes_wrong_at_the_end_has_the_time_of_the_end(what, status, plant_file, faulty):
    (found,) = run(bench(plant_file, faulty(Fault(what, "terminate", 0.0))), short_cases((STRUCK,)))
    assert (found.result.status, found.result.time) == (status, float(STRUCK))


def test_a_hang_on_the_way_is_waited_for_once(plant_file, faulty, monkeypatch):
    """What ran before in the process may keep the next case from starting; a hang on the way is the case's own."""
    starts, started = [], supervision.started
    monkeypatch.setattr(supervision, "started", lambda job, stop: starts.append(job) or started(job, stop))
    own = bench(plant_file, faulty(Fault("spin", "step", 0.02, -float(STRUCK) * 1e3)), HANG_LIMIT)
    done, hung = supervision.run_isolated(judge_job(PROTOCOL, short_cases((SPARED, STRUCK)), own))
    assert done.value.status is DONE and (hung.index, hung.timeout) == (1, True)
    assert len(starts) == 1


@pytest.mark.parametrize(
    ("fault", "status", "call"),
    [
        (Fault("segfault", "initialize", 0.0), CRASHED, "enterInitializationMode"),
        (Fault("spin", "step", 0.0), TIMEOUT, "fmi2DoStep"),
    ],
    ids=str,
)
def test_a_failure_in_the_first_sample_is_told_at_once(fault, status, call, plant_file, faulty):
    own = replace(bench(plant_file, faulty(fault)), timeout=2.0)
    cases = short_cases((STRUCK,) * 4)
    failure = rehearsal.rehearse(cases[0], own).failure
    assert failure is not None and (failure.result.status, failure.result.time) == (status, 0.0)
    assert f"in the call '{call}' of the controller" in failure.result.message
    found = answered(own, cases, never, first_sample_failure=failure)
    assert found[0] == failure and statuses(found[1:]) == [SKIPPED] * 3
    again = answered(own, cases[1:], never, first_sample_failure=failure)
    assert again == found[1:]  # a run that was interrupted after the first result


LATER = [
    Fault("abort", "step", 0.02),
    Fault("abort", "terminate", 0.0),
    Fault("segfault", "initialize", 0.0, which=2),
    Fault("kill:9", "step", 0.0),
]


@pytest.mark.parametrize("fault", LATER, ids=str)
def test_what_does_not_show_in_the_first_sample_is_left_to_the_cases(fault, plant_file, faulty):
    case, own = short_cases((STRUCK,))[0], bench(plant_file, faulty(fault))
    assert rehearsal.rehearse(case, own).failure is None
    assert rehearsal.computing_time(case, own) is None


def test_the_rehearsal_gives_those_more_time_whose_cases_have_more(harmless, monkeypatch):
    limits = []
    monkeypatch.setattr(rehearsal, "run_isolated", lambda job: limits.append(job.time_limits[0]) or iter(()))
    rehearsal.rehearse(short_cases((STRUCK,))[0], replace(harmless, timeout=240.0))
    assert limits[0] == pytest.approx(120.0, abs=0.01)


def test_keep_going_runs_all_and_what_failed_again(faulty, tmp_path):
    controller, benchmark = Controller(faulty(Fault("abort", "step", 0.0))), Benchmark("quick", workers=2)
    # What a document says does not depend on what an earlier run has stored.
    for keep_going, rest in ((False, SKIPPED), (True, CRASHED), (True, CRASHED), (False, SKIPPED)):
        options = {"only": "c00.*", "folder": tmp_path, "recordings": False, "keep_going": keep_going}
        first, *others = [case.status for case in benchmark.evaluate(controller, **options).cases]
        assert first is CRASHED and set(others) == {rest}


@pytest.mark.parametrize(("logged", "told"), [(MANY_LOGGED, 0), (MANY_LOGGED + 1, 1)])
def test_a_controller_that_logs_so_much_that_it_takes_time_is_told_once(logged, told, harmless, caplog):
    done = Judgement(status=ERROR, time=0.1, message="x.fmu: doStep failed")

    def execute(jobs):
        yield from ((0, Done(number, done, 1.0, logged)) for number in range(3))

    answered(harmless, short_cases((STRUCK,) * 3), execute, keep_going=True)
    assert [record.message for record in caplog.records] == told * [
        f"{harmless.controller.name} logged 1.0 million messages in a simulation, which takes time: "
        "switch its logging off."
    ]


def test_messages_are_counted_in_a_worker(plant_file, faulty):
    own = bench(plant_file, faulty(Fault("chat:3:5:0", "step", 0.0)))
    (outcome,) = supervision.run_isolated(judge_job(PROTOCOL, short_cases((STRUCK,)), own))
    assert outcome.logged == 200 * 3 * 5
