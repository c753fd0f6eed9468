"""A simulation that stands still is told while it does: where, since when, and when it is ended."""

import logging
import math
from dataclasses import replace

import pytest
from hostile.fmus import Fault
from hostile.runs import HANG_LIMIT, PLENTY, PROTOCOL, SPARED, STRUCK, bench, run, short_cases
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.benchmark.cases import cases
from orchestrator.cli import guard
from orchestrator.execution import standstill
from orchestrator.execution.standstill import STANDSTILL_TIME, Lookout, Standstill
from orchestrator.execution.supervision import run_isolated
from orchestrator.execution.time_limit import PROCESSOR_REACHED, WAITING_FACTOR, WAITING_REACHED, TimeSpent
from orchestrator.fmi.trace import CONTROLLER, NOBODY, Place
from orchestrator.loop.trajectory import Status
from orchestrator.pairing import runs
from orchestrator.pairing.pairing import judge_job
from orchestrator.pairing.runs import standstill_words
from plant_fmu.flexible_manipulator.parameters import NOMINAL

STEP = Place(1200, CONTROLLER, "fmi2DoStep")

places = st.builds(Place, st.integers(0, 3), st.integers(0, 2), st.sampled_from(["", "fmi2DoStep"]))


def looked(*looks: tuple[float, Place, TimeSpent], limit: float = 60.0, longest: float = math.inf) -> list[Standstill]:
    """What is told after looks at times [s]."""
    lookout, told = Lookout(), []
    for time, place, spent in looks:
        lookout = lookout.after(0, place, time, spent)
        if (found := lookout.standstill(time, spent, limit, longest)) is not None:
            told.append(found)
            lookout = lookout.silent()
    return told


@given(st.floats(0.05, 1.0), st.floats(1.0, 1e3))
def test_one_that_computes_is_ended_by_its_processor_time(pace, limit):
    """At the pace at which it gets a processor, as on a busy machine."""
    (told,) = looked(*((t, STEP, TimeSpent(processor=1.0 + pace * t)) for t in (0.0, 5.0, 11.0, 20.0)), limit=limit)
    assert (told.place, told.seconds, told.limit) == (STEP, 11.0, PROCESSOR_REACHED)
    assert told.remaining == pytest.approx(max(limit - 1.0 - 11.0 * pace, 0.0) / pace)


@given(st.floats(20.0, 1e3))
def test_one_that_waits_is_ended_by_its_waiting(limit):
    (told,) = looked(*((t, STEP, TimeSpent(processor=1.0, waited=t)) for t in (0.0, 10.0, 30.0)), limit=limit)
    assert (told.seconds, told.limit) == (10.0, WAITING_REACHED)
    assert told.remaining == pytest.approx(WAITING_FACTOR * limit - 10.0)


def test_what_was_spent_before_does_not_count_against_the_longest_call():
    looks = [(0.0, replace(STEP, sample=1), TimeSpent(40.0, 80.0)), (1.0, STEP, TimeSpent(50.0, 90.0))]
    (told,) = looked(*looks, (11.0, STEP, TimeSpent(60.0, 90.0)), limit=143.0, longest=65.0)
    assert (told.remaining, told.limit) == (pytest.approx(55.0), PROCESSOR_REACHED)
    (told,) = looked(*looks, (11.0, STEP, TimeSpent(50.0, 100.0)), limit=143.0, longest=65.0)
    assert (told.remaining, told.limit) == (pytest.approx(120.0), WAITING_REACHED)


def test_one_call_may_not_take_longer_than_a_whole_case(harmless):
    """A case that may go on until 60 s in doubt has a longer limit, for its many samples."""
    case = next(case for case in cases(PROTOCOL, NOMINAL, 0) if case.test.requirements)
    job = judge_job(PROTOCOL, [case], replace(harmless, timeout=60.0))
    assert (job.time_limits[0], job.longest_call) == (pytest.approx(5.0 + 60.0 * 60.0 / 26.0), 65.0)


@pytest.mark.needs("linux")
@pytest.mark.usefixtures("no_slack")
@pytest.mark.parametrize(("what", "kind"), [("sleep", WAITING_REACHED), ("spin", PROCESSOR_REACHED)])
def test_a_call_that_takes_longer_ends_the_case(what, kind, plant_file, faulty):
    own = bench(plant_file, faulty(Fault(what)))
    job = replace(judge_job(PROTOCOL, short_cases((STRUCK,)), own), longest_call=0.5 * HANG_LIMIT)
    (died,) = run_isolated(job)
    assert (died.kind, died.timeout, died.place.call) == (kind, True, "fmi2DoStep")


def test_one_that_gets_no_processor_is_ended_nobody_knows_when():
    (told,) = looked((0.0, STEP, TimeSpent()), (10.0, STEP, TimeSpent()))
    assert told.remaining == math.inf
    assert standstill_words(told, "c00", None).endswith("It is ended when the limit of processor time is reached.")


@given(st.lists(st.tuples(st.floats(0.0, STANDSTILL_TIME / 2), places), max_size=30))
def test_each_standstill_is_told_once_and_nothing_else(steps):
    time, looks = 0.0, []
    for passed, place in steps:
        time += passed
        looks.append((time, place, TimeSpent(waited=time)))
    expected, since, last, told = 0, 0.0, None, False
    for time, place, _ in looks:
        if place != last:
            last, since, told = place, time, False
        elif not told and time - since >= STANDSTILL_TIME:
            expected, told = expected + 1, True
    assert len(looked(*looks)) == expected


def test_the_next_task_at_the_same_place_is_another_one():
    before = Lookout().after(0, STEP, 0.0, TimeSpent())
    assert (
        before.after(1, STEP, STANDSTILL_TIME, TimeSpent()).standstill(STANDSTILL_TIME, TimeSpent(), 60.0, 60.0) is None
    )


def test_the_words_name_place_time_limit_and_end():
    (case,) = short_cases((SPARED,))
    words = standstill_words(Standstill(STEP, 10.2, 119.6, WAITING_REACHED), case.id, case.scenario)
    assert words == (
        f"{case.id} has stood still for 10 s, in the call 'fmi2DoStep' of the controller at t = 0.3 s. "
        "It is ended when the limit of waiting is reached, in about 120 s."
    )
    outside = standstill_words(Standstill(Place(0, NOBODY, ""), 10.0, 5.0, PROCESSOR_REACHED), "A simulation", None)
    assert "still for 10 s, outside any FMI call. It" in outside
    soon = standstill_words(Standstill(STEP, 10.2, 0.2, WAITING_REACHED), case.id, case.scenario)
    assert soon.endswith("reached, within a second.")


def test_a_command_names_the_option_that_shortens_it(capsys, monkeypatch):
    def command(_: object) -> int:
        runs.tell_standstill(Standstill(STEP, 10.2, 119.6, WAITING_REACHED), "The controller's process")
        return 0

    guard.guarded(command)
    assert capsys.readouterr().err == (
        "The controller's process has stood still for 10 s, in the call 'fmi2DoStep' of the controller. "
        "It is ended when the limit of waiting is reached, in about 120 s. (--timeout shortens this)\n"
    )


@pytest.mark.needs("linux")
@pytest.mark.usefixtures("no_slack")
@pytest.mark.parametrize(
    ("what", "limit"), [("sleep", "the limit of waiting is"), ("spin", "the limit of processor time is")]
)
def test_a_controller_that_hangs_is_told_before_it_is_ended(what, limit, plant_file, faulty, caplog, monkeypatch):
    own = bench(plant_file, faulty(Fault(what, "step", 0.02, -float(STRUCK) * 1e3)), HANG_LIMIT)
    chosen = short_cases((SPARED, STRUCK))
    run(own, chosen[:1])  # on a cold cache, the compilation takes longer than this test's patience, too
    monkeypatch.setattr(standstill, "STANDSTILL_TIME", 0.3 * HANG_LIMIT)
    spared, struck = run(own, chosen)
    assert (spared.result.status, struck.result.status) == (Status.DONE, Status.TIMEOUT)
    (record,) = (record for record in caplog.records if record.name == runs.logger.name)
    assert record.levelno == logging.WARNING
    assert record.getMessage().startswith(f"{chosen[1].id} has stood still for ")
    assert f"in the call 'fmi2DoStep' of the controller at t = 0.02 s. It is ended when {limit}" in record.getMessage()


@pytest.mark.needs("linux")
@pytest.mark.usefixtures("no_slack")
def test_a_healthy_controller_is_not(harmless, caplog):
    assert [found.result.status for found in run(replace(harmless, timeout=PLENTY), short_cases((SPARED,)))] == [
        Status.DONE
    ]
    assert not caplog.records
