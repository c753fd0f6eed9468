"""What becomes of runs, and which comes next: pure functions."""

from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.service import queue, states
from orchestrator.service.records import SHORT, STAGES, Outcome, State, Submission

RUN = Submission("a" * 24, "ada", "my.fmu", "my.fmu", "0" * 64, 100, 1.0)


def done(run: Submission, **fields) -> Submission:
    run, _ = states.started(run, 5.0)
    return states.ended(run, Outcome(run.stage, **{"kind": "done", **fields}), 6.0)[0]


def test_a_run_goes_through_its_stages_and_keeps_what_they_give():
    run = done(RUN, verdict="note")
    assert (run.state, run.stage, run.verdict, run.running) == (State.QUICK, "quick", "note", False)
    run = done(run, cost=120.0)
    assert (run.state, run.quick_cost, run.cost) == (State.EVALUATING, 120.0, None)
    run = done(run, cost=99.0, holds=True, disk=7)
    assert (run.state, run.cost, run.holds, run.disk, run.stage) == (State.FINISHED, 99.0, True, 7, None)
    assert [state for _, state in states.steps(run)] == ["done"] * 3


@pytest.mark.parametrize(("kind", "state"), [("refused", State.REFUSED), ("failed", State.FAILED)])
def test_a_fault_of_the_controller_is_final_at_once(kind, state):
    run = done(RUN, kind=kind, reason="it divides by zero")
    assert (run.state, run.reason, run.attempts) == (state, "it divides by zero", 0)


LOST = {"lost": True, "remark": "incomplete: 3 lost, 2 skipped"}
CASES = "cases were lost"


@pytest.mark.parametrize(
    ("stage", "fields", "words"),
    [("checking", {"kind": "fault", "reason": "disk full"}, "disk full"), ("quick", LOST, CASES)]
    + [("evaluating", LOST, CASES)],
)
def test_a_fault_of_the_machine_is_tried_again_three_times_and_held_against_nobody(stage, fields, words):
    """An evaluation whose cases the machine had lost each time was finished, without a V, and could not begin again."""
    run = replace(RUN, state=State(stage))
    for attempt in (1, 2):
        run = done(run, **fields)
        assert (run.attempts, run.stage, run.running) == (attempt, stage, False) and run.not_before > 6.0
    run, text = states.ended(states.started(run, 5.0)[0], Outcome(stage, **{"kind": "done", **fields}), 6.0)
    assert run.state is State.FAILED and "nothing is held against the controller" in run.reason and words in text
    assert (run.attempts, run.finished, run.remark) == (0, 0.0, "")
    assert states.retried(run)[0].state is State.RECEIVED


def test_an_end_of_the_service_queues_again_and_is_no_attempt():
    run, _ = states.started(RUN, 5.0)
    run, text = states.interrupted(run)
    assert (run.state, run.running, run.attempts, run.interruptions) == (State.CHECKING, False, 0, 1)
    assert "queued again" in text
    run = replace(run, running=True, interruptions=states.MAX_INTERRUPTIONS - 1)
    assert states.interrupted(run)[0].state is State.FAILED


def test_a_refused_run_begins_again_with_another_binding():
    refused = done(RUN, kind="refused", reason="no q_m")
    run, _ = states.bound(refused, 6)
    assert (run.state, run.bound, run.reason, run.stage) == (State.RECEIVED, 6, "", "checking")


def waiting(*places: tuple[str, str]) -> list[Submission]:
    """Runs of these owners in these states, in this order."""
    return [
        replace(RUN, id=str(number), owner=owner, state=State(state), created=float(number))
        for number, (owner, state) in enumerate(places)
    ]


def order(runs: list[Submission], evaluations: int = 1) -> list[str]:
    """The owners of the runs in the order in which they are chosen, if each ends before the next begins."""
    served, found, now = {}, [], 100.0
    while runs:
        run = queue.chosen(runs, [], served, evaluations, now)
        runs = [other for other in runs if other is not run]
        served[run.owner] = now = now + 1
        found.append(run.owner)
    return found


def test_people_take_turns():
    runs = waiting(*[("ada", "received")] * 4, ("ben", "received"), ("cid", "received"))
    assert order(runs) == ["ada", "ben", "cid", "ada", "ada", "ada"]


def test_short_stages_come_first_and_have_room_beside_evaluations():
    long, short = waiting(("ada", "evaluating"), ("ben", "quick"))
    assert queue.chosen([long, short], [], {}, 1, 9.0) is short
    under_way = [replace(long, running=True)]
    assert queue.chosen([long], under_way, {}, 1, 9.0) is None
    assert queue.chosen([long, short], under_way, {}, 1, 9.0) is short
    assert queue.chosen([long, short], [*under_way, replace(short, running=True)], {}, 1, 9.0) is None


def test_short_stages_hold_back_no_evaluation():
    """The checks of 20 uploads took both places until the last of them had ended."""
    long, short, other = waiting(("ada", "evaluating"), ("ben", "received"), ("ben", "received"))
    under_way = [replace(short, running=True)]
    assert queue.chosen([long, other], under_way, {"ada": 8.0}, 1, 9.0) is long
    assert queue.chosen([replace(long, not_before=10.0), other], under_way, {}, 1, 9.0) is other
    assert queue.chosen([long, other], under_way * 2, {}, 1, 9.0) is None
    assert queue.chosen([long, other], [replace(long, running=True)], {}, 2, 9.0) is other


def test_who_has_to_wait_waits():
    (run,) = waiting(("ada", "received"))
    assert queue.chosen([replace(run, not_before=10.0)], [], {}, 1, 9.0) is None
    assert queue.chosen([replace(run, not_before=10.0)], [], {}, 1, 10.0) is not None
    assert queue.chosen([replace(run, not_before=10.0)], [], {}, 1, -86400.0) is not None, "the clock was set back"


@given(st.lists(st.tuples(st.sampled_from("abc"), st.sampled_from(["received", "quick", "evaluating"])), max_size=12))
def test_the_places_that_are_told_are_those_in_which_the_stages_begin(places):
    runs = waiting(*places)
    for short in (True, False):
        alike = [run for run in runs if (run.stage in SHORT) is short]
        told = queue.places(runs, {})
        by_place = sorted(alike, key=lambda run: told[run.id])
        assert [told[run.id] for run in by_place] == list(range(len(alike)))
        assert [run.owner for run in by_place] == order(alike)


VERIFYING, _ = states.chosen(replace(RUN, state=State.FINISHED, cost=99.0, holds=True), "c" * 24)


def test_what_counts_in_a_closed_round_is_verified_and_its_evaluation_stays():
    run = done(VERIFYING, cost=101.0, holds=False, deviations="no sandbox")
    assert (run.state, run.cost, run.holds) == (State.FINISHED, 99.0, True)
    assert (run.drawn_cost, run.drawn_holds, run.drawn_remark, run.deviations) == (101.0, False, "", "no sandbox")
    assert [state for _, state in states.steps(run)] == ["done"] * 4


@pytest.mark.parametrize("kind", ["refused", "failed"])
def test_a_controller_that_cannot_be_verified_is_finished_without_a_place(kind):
    run = done(VERIFYING, kind=kind, reason="it hangs")
    assert (run.state, run.cost, run.drawn_cost, run.drawn_remark) == (
        *(State.FINISHED, 99.0, None, "not verified: it hangs"),
    )


def test_a_verification_that_the_machine_failed_begins_again_as_one():
    run = VERIFYING
    for _ in range(states.MAX_ATTEMPTS):
        run = done(run, kind="fault", reason="disk full")
    assert run.state is State.FAILED and [state for _, state in states.steps(run)] == ["done"] * 3 + ["ended"]
    assert states.retried(run)[0].state is State.VERIFYING
    run, _ = states.interrupted(states.started(VERIFYING, 5.0)[0])
    assert (run.state, run.running, run.round) == (State.VERIFYING, False, VERIFYING.round)


def test_a_verification_that_lost_cases_each_time_can_begin_again():
    run = VERIFYING
    for _ in range(states.MAX_ATTEMPTS):
        run = done(run, cost=101.0, lost=True, remark="cases were lost")
    assert run.state is State.FAILED and run.drawn_cost is None and "cases were lost to this machine" in run.reason
    assert states.retried(run)[0].state is State.VERIFYING


def test_every_state_is_final_or_has_a_stage():
    for state in State:
        assert state.is_final == (replace(RUN, state=state).stage is None)
    assert len(STAGES) == 4
