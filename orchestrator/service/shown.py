"""What is shown of runs, as plain values: the same for pages, programs and live progress."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Literal

from ..codec import Finite, Natural, Struct
from .records import Stage, State, Submission
from .service import Service
from .states import steps

StepState = Literal["done", "now", "next", "ended", "left out"]


STATE_WORDS = {
    State.RECEIVED: "waits for its check",
    State.CHECKING: "is checked",
    State.QUICK: "quick evaluation",
    State.EVALUATING: "evaluation",
    State.FINISHED: "finished",
    State.REFUSED: "refused",
    State.FAILED: "failed",
    State.CANCELLED: "cancelled",
}


class StepView(Struct):
    """A stage, and where it is."""

    stage: Stage
    state: StepState


class EventView(Struct):
    """A line of the history of a run, with its time in UTC."""

    at: str
    text: str


class FindingView(Struct):
    """A finding of a check that lasts: how much it matters, of what, and what was found."""

    severity: str
    subject: str
    text: str


class RunView(Struct):
    """A run as its owner sees it. ``state`` and ``waiting`` say where it is; ``ahead`` counts the stages that begin
    before its own; ``done`` of ``total`` cases are simulated, and ``cost_so_far`` is V of the complete ones. ``cost``
    is V on the protocol, ``quick_cost`` on the short one; ``remark`` says why a result has no rank."""

    id: str
    name: str
    sha256: str
    size: Natural
    created: str
    state: str
    is_final: bool
    waiting: bool
    revision: Natural
    reason: str
    verdict: str
    steps: tuple[StepView, ...]
    ahead: Natural | None = None
    done: Natural = 0
    total: Natural = 0
    cost_so_far: Finite | None = None
    findings: tuple[FindingView, ...] = ()
    quick_cost: Finite | None = None
    cost: Finite | None = None
    holds: bool | None = None
    remark: str = ""
    binding: str = ""
    command: str = ""
    history: tuple[EventView, ...] = ()


class RowView(Struct):
    """A finished run as everybody sees it."""

    name: str
    person: str
    cost: Finite | None
    holds: bool | None
    remark: str
    finished: str
    own: str = ""


def run_view(service: Service, run: Submission, whole: bool = True) -> RunView:
    """A run for its owner; its history and its place in the queue only if the ``whole`` is asked for."""
    live = service.runner.live.get(run.id)
    progress = live.progress if live is not None and not live.unwanted else None
    waits = not run.state.is_final and not run.running
    return RunView(
        id=run.id,
        name=run.name,
        sha256=run.sha256,
        size=run.size,
        created=moment(run.created),
        state=run.state.value,
        is_final=run.state.is_final,
        waiting=waits,
        revision=run.revision,
        reason=run.reason,
        verdict=run.verdict,
        steps=tuple(StepView(*step) for step in steps(run)),  # type: ignore[arg-type]
        ahead=service.runner.place(run) if whole and waits else None,
        done=progress.done if progress else 0,
        total=progress.total if progress else 0,
        cost_so_far=progress.cost if progress else None,
        findings=tuple(FindingView(*finding) for finding in live.findings) if live is not None and whole else (),
        quick_cost=run.quick_cost,
        cost=run.cost,
        holds=run.holds,
        remark=run.remark,
        binding=run.binding if whole else "",
        command=service.command(run) if whole else "",
        history=tuple(EventView(moment(at), text) for at, text in service.database.history(run.id)) if whole else (),
    )


def table(service: Service, person_id: str) -> list[RowView]:
    """Finished runs of everybody, best first; of each person's controllers of one name the latest alone."""
    names = {person.id: person.name for person in service.database.people()}
    return [
        RowView(
            name=run.name,
            person=names.get(run.owner, ""),
            cost=run.cost,
            holds=run.holds,
            remark=run.remark,
            finished=moment(run.started),
            own=run.id if run.owner == person_id else "",
        )
        for run in service.database.finished()
    ]


def moment(seconds: float) -> str:
    """A time as text, in UTC."""
    return datetime.fromtimestamp(seconds, timezone.utc).strftime("%Y-%m-%d %H:%M:%S")


def shown_cost(value: float | None) -> str:
    """V for people."""
    return "–" if value is None else f"{value:.1f}"


def state_words(run: Submission) -> str:
    """Where a run is, in words."""
    waits = run.state in (State.CHECKING, State.QUICK, State.EVALUATING) and not run.running
    return ("waits for its " if waits else "") + STATE_WORDS[run.state]
