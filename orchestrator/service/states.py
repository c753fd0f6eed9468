"""What becomes of a run when something happens to it: pure functions from a run to its next form, with a sentence."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from .records import STAGES, Outcome, Stage, State, Submission

MAX_ATTEMPTS = 3
"""Times that a stage is begun before a fault of the machine counts as the end."""

MAX_INTERRUPTIONS = 100
"""The same for a stage that was under way when the service itself ended. A run that brings the whole machine down would
else do so after every start; the bound is large, since an operator may restart often."""

DELAYS = (2.0, 30.0)
"""Seconds before the second and the third attempt: a full disk or memory needs time to be freed."""

WORDS: Mapping[Stage, str] = {
    "checking": "the check",
    "quick": "the quick evaluation",
    "evaluating": "the evaluation",
    "verifying": "the verification",
}

Change = tuple[Submission, str]
"""The next form of a run, and what is told of the change."""


def waits(run: Submission, now: float) -> bool:
    """Whether its next attempt is too early. A clock that was set back by a day must not delay it by a day."""
    return 0.0 < run.not_before - now <= max(DELAYS)


def started(run: Submission, now: float) -> Change:
    """A process begins with its next stage."""
    assert run.stage is not None, run.state
    begun = replace(run, state=State(run.stage), running=True, started=now, not_before=0.0)
    again = f", attempt {run.attempts + 1} of {MAX_ATTEMPTS}" if run.attempts else ""
    return begun, f"{WORDS[run.stage]} has begun{again}"


def ended(run: Submission, outcome: Outcome, now: float) -> Change:
    """The stage has ended with an ``outcome``. What the machine lost is tried again, while the controller's own faults
    are final: they would only be repeated."""
    disk = outcome.disk or run.disk
    # However often: a run that was finished without a V, for what the machine had lost, could not begin again.
    if outcome.kind == "fault" or outcome.lost:
        return _again(replace(run, disk=disk), outcome.reason or "cases were lost to this machine", now)
    at_rest = replace(run, running=False, attempts=0, interruptions=0, not_before=0.0, disk=disk, reason="")
    if outcome.stage == "verifying":
        return _verified(at_rest, outcome)
    if outcome.kind == "refused":
        refused = replace(at_rest, state=State.REFUSED, reason=outcome.reason, verdict=outcome.verdict)
        return refused, f"refused: {outcome.reason}"
    if outcome.kind == "failed":
        return replace(at_rest, state=State.FAILED, reason=outcome.reason), f"failed: {outcome.reason}"
    if outcome.stage == "checking":
        passed = replace(at_rest, state=State.QUICK, verdict=outcome.verdict)
        return passed, "the check has passed"
    if outcome.stage == "quick":
        return replace(at_rest, state=State.EVALUATING, quick_cost=outcome.cost), "the quick evaluation has ended"
    ranked = replace(at_rest, cost=outcome.cost, holds=outcome.holds, remark=outcome.remark)
    return replace(ranked, state=State.FINISHED, finished=now), "finished"


def _verified(run: Submission, outcome: Outcome) -> Change:
    """A controller that cannot be verified has no place, but its evaluation stays what it was."""
    if outcome.kind != "done":
        remark = f"not verified: {outcome.reason}"
        return replace(run, state=State.FINISHED, drawn_remark=remark), remark
    finished = replace(
        run,
        state=State.FINISHED,
        drawn_cost=outcome.cost,
        drawn_holds=outcome.holds,
        drawn_remark=outcome.remark,
        deviations=outcome.deviations,
    )
    return finished, "verified"


def _again(run: Submission, reason: str, now: float) -> Change:
    attempts = run.attempts + 1
    if attempts >= MAX_ATTEMPTS:
        text = f"{reason} (this machine failed {attempts} times; nothing is held against the controller)"
        return replace(run, state=State.FAILED, running=False, attempts=0, reason=text), f"failed: {text}"
    delay = DELAYS[min(attempts, len(DELAYS)) - 1]
    # The next attempt is not the one that a service may have left under way: its outcome is another.
    waiting = replace(run, running=False, attempts=attempts, interruptions=0, not_before=now + delay, reason=reason)
    return waiting, f"a fault of this machine: {reason}; it is tried again in {delay:g} s"


def interrupted(run: Submission) -> Change:
    """The service ended while a stage was under way: it is queued again."""
    times = run.interruptions + 1
    if times >= MAX_INTERRUPTIONS:
        text = f"the service has ended {times} times during this stage"
        return replace(run, state=State.FAILED, running=False, interruptions=0, reason=text), f"failed: {text}"
    return replace(run, running=False, interruptions=times), "queued again after an end of the service"


def cancelled(run: Submission) -> Change:
    """Its owner wants no more of it."""
    return replace(run, state=State.CANCELLED, running=False, attempts=0, not_before=0.0, reason=""), "cancelled"


def retried(run: Submission) -> Change:
    """A run that failed or was cancelled begins again where it was; what is finished is found in its store."""
    state = State.VERIFYING if run.round else State.RECEIVED
    return replace(run, state=state, attempts=0, interruptions=0, not_before=0.0, reason=""), "begun again"


def chosen(run: Submission, round: str) -> Change:
    """A finished run counts in the ``round`` (its id), which is closed: it is to be verified."""
    return replace(run, state=State.VERIFYING, round=round), "the round is closed, in which this run counts"


def bound(run: Submission, size: int) -> Change:
    """A refused run gets another binding of this ``size`` [bytes], and begins again."""
    changed = replace(run, bound=size, state=State.RECEIVED, attempts=0, not_before=0.0, reason="", verdict="")
    return changed, "bound anew"


def steps(run: Submission) -> tuple[tuple[str, str], ...]:
    """The stages, and where each is: ``"done"``, ``"now"``, ``"next"`` or ``"left out"``."""
    stages = STAGES if run.round else STAGES[:-1]
    if run.state is State.FINISHED:
        return tuple((stage, "done") for stage in stages)
    here = STAGES.index(run.stage) if run.stage is not None else _reached(run)
    words = "left out" if run.state.is_final else "next"
    now = "ended" if run.state.is_final else "now"
    return tuple(
        (stage, "done" if place < here else now if place == here else words) for place, stage in enumerate(stages)
    )


def _reached(run: Submission) -> int:
    """The stage that a run ended in before its time."""
    if run.round:
        return 3
    return 2 if run.quick_cost is not None else 1 if run.verdict and run.state is not State.REFUSED else 0
