"""What a worker's messages and looks at it come to, without a process: each decision, and what holds for all."""

import math
from dataclasses import replace
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.refusals import refusal

from orchestrator.codec import Malformed
from orchestrator.errors import EnvironmentFault
from orchestrator.execution.job import MANY_LOGGED, Died, Done, Job, Limits
from orchestrator.execution.messages import ErrorRecord, Failed, Finished, Garbage, Loaded
from orchestrator.execution.process_tree import Use
from orchestrator.execution.standstill import STANDSTILL_TIME, Standstill
from orchestrator.execution.time_limit import PROCESSOR_REACHED, WAITING_FACTOR, WAITING_REACHED, TimeSpent
from orchestrator.execution.worker_life import (
    FRESH_START_TIMEOUT,
    GARBAGE,
    START_TIMEOUT,
    Answer,
    Death,
    Event,
    Life,
    Looked,
    Printed,
    ProcessEnded,
    Received,
    Remains,
    died,
    on,
)
from orchestrator.fmi.trace import CONTROLLER, NOBODY, PLANT, Place

TASKS, LIMIT, LONGEST = 3, 60.0, 50.0
STEP = Place(7, CONTROLLER, "fmi2DoStep")


def decode(index: int, value: bytes) -> bytes:
    """Values are the number of their task."""
    if value != str(index).encode():
        raise Malformed("a value of another task")
    return value


FMU = SimpleNamespace()
"""Never looked at: nothing is started."""
JOB = Job(
    FMU,
    FMU,
    "module:work",
    (b"",) * TASKS,
    (LIMIT,) * TASKS,
    decode,
    limits=Limits(memory=1_000_000, output=2_000_000, processes=3, threads=5),
    longest_call=LONGEST,
)
BORN, LOADED = Life(), Life(loaded=True)


def finished(index: int, value: bytes | None = None, logged: int = 0) -> Received:
    """A task is done."""
    return Received(Finished(index, str(index).encode() if value is None else value, 0.5), logged)


def failed(kind: str, index: int = 0, what: str = "") -> Received:
    """A task failed with an error of a kind."""
    return Received(Failed(index, ErrorRecord(kind, "it failed", what), 0.5))


def looked(
    time: float = 1.0,
    memory: int = 0,
    processes: int = 1,
    threads: int = 1,
    end: ProcessEnded | None = None,
    place: Place = STEP,
    **spent,
) -> Looked:
    """A look at a worker that has ``spent`` so much."""
    return Looked(time, Use(0.0, 0.0, memory, False, False, processes, threads), TimeSpent(**spent), place, end)


ABORTED, KILLED = (
    ProcessEnded("the process was ended by SIGABRT", False),
    ProcessEnded("the process was ended by SIGKILL", True),
)
FORGED = [
    Received(Loaded()),
    Received(Garbage("no message")),
    finished(1),
    finished(0, b"1"),
    failed("fmu", 1),
]

DEATHS = {
    "prints": (Printed(2_000_001), Death("it printed or logged more than 2 MB", "it printed or logged too much")),
    "grows": (
        looked(memory=1_200_000),
        Death("it used 1 MB of memory; the limit is 1 MB", "it used too much memory"),
    ),
    "starts threads": (looked(threads=6), Death(*("it started more than 5 threads",) * 2)),
    "forks": (looked(processes=4), Death(*("it started more than 3 processes",) * 2)),
    "ends": (looked(end=ABORTED), Death(ABORTED.words, ABORTED.words)),
    "is killed": (KILLED, Death(KILLED.words, KILLED.words, outside=True)),
    "crashes in isolation": (failed("crash"), Death("it failed", "it failed")),
    "is killed in isolation": (failed("crash", what="killed"), Death("it failed", "it failed", outside=True)),
    "computes": (
        looked(processor=60.5),
        Death(f"{PROCESSOR_REACHED}: 60.5 s of 60 s", PROCESSOR_REACHED, timeout=True),
    ),
    "is stopped": (
        looked(waited=121.0, stopped=True),
        Death(
            f"{WAITING_REACHED}: for 121.0 s of 120 s it was not seen to compute, and it computed for 0.0 s",
            WAITING_REACHED,
            timeout=True,
            outside=True,
        ),
    ),
    "is large and computes": (
        looked(memory=1_200_000, processor=61.0, end=KILLED),
        Death("it used 1 MB of memory; the limit is 1 MB", "it used too much memory"),
    ),
    "computes and ends": (
        looked(processor=61.0, end=KILLED),
        Death(f"{PROCESSOR_REACHED}: 61.0 s of 60 s", PROCESSOR_REACHED, timeout=True),
    ),
}


def test_a_worker_may_end_before_its_last_task():
    life, answer = on(LOADED, Received(Finished(0, b"0", 0.5, last=True)), JOB)
    assert life.over and answer == Done(0, b"0", 0.5, 0)


@pytest.mark.parametrize("name", DEATHS)
def test_what_ends_a_worker(name):
    event, death = DEATHS[name]
    life, answer = on(LOADED, event, JOB)
    assert life.over and answer == death


@pytest.mark.parametrize("event", FORGED, ids=str)
def test_what_is_not_due_is_forged(event):
    life, death = on(LOADED, event, JOB)
    assert life.over and death.kind == GARBAGE and death.message.startswith(f"{GARBAGE} (")
    assert (death.timeout, death.outside) == (False, False)


def test_a_result_before_the_fmus_are_loaded_is_forged_and_an_error_is_not():
    assert on(Life(), finished(0), JOB)[1].kind == GARBAGE
    assert on(Life(), failed("fmu"), JOB) == (Life(over=True), failed("fmu").message)


def test_a_fault_of_the_environment_is_an_error():
    life, error = on(LOADED, failed("environment", what="disk"), JOB)
    assert life.over and isinstance(error, EnvironmentFault) and error.what == "disk"


def test_the_way_through_all_tasks():
    life, answers = Life(), []
    for event in (Received(Loaded()), Printed(1_500_000), finished(0, logged=4), Printed(1_500_000), finished(1)):
        life, answer = on(life, event, JOB)
        answers.append(answer)
    assert answers == [None, None, Done(0, b"0", 0.5, 4), None, Done(1, b"1", 0.5)]
    assert (life.task, life.printed, life.over) == (2, 0, False), "what is printed counts for one task"
    life, last = on(life, finished(2), JOB)
    assert (life.over, last) == (True, Done(2, b"2", 0.5))


@pytest.mark.parametrize(
    ("job", "start"),
    [
        (JOB, START_TIMEOUT),
        (replace(JOB, sandbox=True), FRESH_START_TIMEOUT),
        (replace(JOB, sandbox=True, isolated=True), START_TIMEOUT),
    ],
)
def test_who_loads_has_longer(job, start):
    assert Life().limits(job) == (LIMIT + start, math.inf)
    assert LOADED.limits(job) == (LIMIT, LONGEST)


def test_one_place_has_a_limit_of_its_own():
    life, answer = on(LOADED, looked(processor=5.0), JOB)
    assert answer is None
    assert on(life, looked(processor=5.0 + LONGEST), JOB)[1] is None
    assert on(life, looked(processor=5.1 + LONGEST), JOB)[1].timeout
    assert on(life, looked(processor=5.1 + LONGEST, place=replace(STEP, sample=8)), JOB)[1] is None


def test_a_standstill_is_told_once():
    life, answer = on(LOADED, looked(0.0), JOB)
    told = []
    for time in (0.5 * STANDSTILL_TIME, STANDSTILL_TIME, 2.0 * STANDSTILL_TIME):
        life, answer = on(life, looked(time), JOB)
        told.append(answer)
    assert told == [None, Standstill(STEP, STANDSTILL_TIME, math.inf, PROCESSOR_REACHED), None]


REMAINS = Remains(STEP, ("out of cheese",), 0, 2.5)


def test_the_outcome_of_the_task_that_it_died_in():
    death, life = Death("it died", "kind", outside=True), Life(task=1, loaded=True, over=True)
    assert died(life, death, REMAINS) == Died(1, False, "it died", "kind", 2.5, STEP, ("out of cheese",), True)


@pytest.mark.parametrize("timeout", [False, True])
def test_many_messages_explain_a_time_limit(timeout):
    found = died(LOADED, Death("it died", "kind", timeout), replace(REMAINS, logged=MANY_LOGGED + 1))
    assert found.message == "it died" + "; it had logged 1000001 messages, which takes time" * timeout
    assert found.kind == "kind"


@pytest.mark.parametrize("side", [NOBODY, PLANT])
def test_before_the_controller_comes_it_is_a_fault_of_the_environment(side):
    remains, death = replace(REMAINS, place=Place(0, side, "")), Death("it died", "kind")
    error = refusal(died, Life(), death, remains, kind=EnvironmentFault)
    assert error.what == "worker-lost" and str(error).endswith("loaded the FMUs: it died\n  out of cheese")
    assert died(Life(), death, REMAINS).place == STEP, "the controller was being loaded"
    assert died(LOADED, death, remains).message == "it died"


amounts, counts = st.floats(0.0, 500.0), st.integers(0, 4)
spent = st.builds(TimeSpent, amounts, amounts, st.booleans())
places = st.builds(Place, st.integers(0, 2), st.integers(0, 2), st.sampled_from(["", "fmi2DoStep"]))
messages = st.one_of(
    st.just(Loaded()),
    st.builds(Garbage),
    st.integers(0, TASKS).map(lambda index: finished(index).message),
    st.builds(
        lambda kind, index: failed(kind, index).message, st.sampled_from(["fmu", "crash", "environment"]), counts
    ),
)
uses = st.builds(
    Use,
    amounts,
    amounts,
    st.integers(0, 1_100_000),
    st.booleans(),
    st.booleans(),
    processes=st.integers(1, 4),
    threads=st.integers(1, 6),
)
looks = st.builds(Looked, amounts, uses, spent, places, st.none() | st.sampled_from([ABORTED, KILLED]))
events = st.one_of(
    st.builds(Printed, st.integers(0, 2_100_000)),
    st.builds(Received, messages, counts),
    st.sampled_from([ABORTED, KILLED]),
    looks,
)
due = st.one_of(
    *(st.just(finished(index)) for index in range(TASKS)), st.just(Received(Loaded())), st.builds(Printed, counts)
)
lives = st.builds(Life, st.integers(0, TASKS - 1), st.booleans())


def lived(course: list[Event], life: Life = BORN) -> list[tuple[Life, Answer | None, Life]]:
    """Before, answer and after, of each event."""
    steps = []
    for event in course:
        after, answer = on(life, event, JOB)
        steps.append((life, answer, after))
        life = after
    return steps


@given(st.lists(due | events, max_size=20), st.lists(events, max_size=5))
def test_after_the_last_outcome_nothing_happens(course, later):
    steps = lived([*course, ABORTED])
    assert steps[-1][2].over
    assert all(answer is None and before == after for before, answer, after in lived(later, steps[-1][2]))
    ends = [answer for before, answer, after in steps if after.over and not before.over]
    assert len(ends) == 1 and ends[0] is not None and not isinstance(ends[0], Standstill)


@given(st.lists(due | events, max_size=20))
def test_tasks_are_answered_in_order_each_once(course):
    outcomes = [answer for _, answer, _ in lived([*course, ABORTED]) if isinstance(answer, Done | Failed | Death)]
    done = [outcome.index for outcome in outcomes if isinstance(outcome, Done)]
    assert done == list(range(len(done))) and len(outcomes) <= TASKS
    assert not any(isinstance(outcome, Failed | Death) for outcome in outcomes[:-1])


@given(lives, st.lists(st.tuples(st.floats(0.0, LONGEST), places), max_size=20))
def test_who_computes_within_its_limits_does_not_hang(life, steps):
    """However long it takes on a busy machine; a standstill is told, but nothing ended."""
    computed = sorted(processor for processor, _ in steps)
    course = [
        looked(1e4 * number, processor=processor, place=place)
        for number, (processor, (_, place)) in enumerate(zip(computed, steps, strict=True))
    ]
    assert all(answer is None or isinstance(answer, Standstill) for _, answer, _ in lived(course, life))


@given(lives, spent, amounts, amounts)
def test_who_spends_more_is_not_spared(life, used, processor, waited):
    """And is ended by no time limit before it has spent it."""
    more = TimeSpent(used.processor + processor, used.waited + waited, used.stopped)
    one, other = (on(life, Looked(1.0, Use(0, 0, 0, True, False), of, STEP), JOB)[1] for of in (used, more))
    assert one is None or (isinstance(other, Death) and other.timeout)
    limit, _ = life.limits(JOB)
    assert (one is not None) == (used.processor > limit or used.waited > WAITING_FACTOR * limit)


@given(lives, looks)
def test_whoever_gives_more_ends_nothing_sooner(life, look):
    larger = replace(
        JOB,
        time_limits=(2 * LIMIT,) * TASKS,
        longest_call=2 * LONGEST,
        limits=Limits(2 * JOB.limits.memory, 2 * JOB.limits.output, 2 * JOB.limits.processes, 2 * JOB.limits.threads),
    )
    if on(life, look, larger)[0].over:
        assert on(life, look, JOB)[0].over
