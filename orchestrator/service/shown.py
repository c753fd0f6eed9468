"""What is shown of runs, as plain values: the same for pages, programs and live progress."""

from __future__ import annotations

from datetime import datetime, timezone
from typing import Literal

from msgspec.structs import astuple, replace

from ..codec import Finite, Natural, Struct
from ..views.export import csv_text
from . import rounds
from .records import HandIn, Round, Stage, State, Submission
from .service import Service
from .states import steps

StepState = Literal["done", "now", "next", "ended", "left out"]


STATE_WORDS = {
    State.RECEIVED: "waits for its check",
    State.CHECKING: "is checked",
    State.QUICK: "quick evaluation",
    State.EVALUATING: "evaluation",
    State.VERIFYING: "verification",
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
    is V on the protocol, ``quick_cost`` on the short one; ``remark`` says why a result has no rank. ``round`` is the id
    of the closed round in which it counts."""

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
    round: str = ""
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


EntryState = Literal["provisional", "verifying", "verified", "not verified", "deleted"]


class EntryView(Struct):
    """What counts for a person in a round. ``cost`` and ``holds`` are of the published list, and provisional;
    ``drawn_cost`` is the mean of V over the draws, and ``drawn_holds`` whether all requirements are met in all of them,
    both of a round that is final, as ``place``. ``remark`` says why there is no place, ``deviations`` by what the
    certificate is not of the standard conditions; ``certificate`` is its name in the archive of all of them."""

    place: Natural | None
    name: str
    person: str
    state: EntryState
    cost: Finite | None
    holds: bool | None
    drawn_cost: Finite | None = None
    drawn_holds: bool | None = None
    remark: str = ""
    deviations: str = ""
    certificate: str = ""
    run: str = ""


class RoundView(Struct):
    """A round. It takes what is handed in from ``opened`` until ``closes``, or until it is ``closed``, all in UTC.
    ``bits``, of which the draws follow, are told when it is final. ``own`` are your runs that may count, the newest
    first, and ``chosen`` is the one that does. Of the ``entries``, ``run`` is the id of your own."""

    id: str
    name: str
    phase: rounds.Phase
    opened: str
    closes: str
    closed: str
    bits: str
    chosen: str
    own: tuple[str, ...]
    failed: Natural
    entries: tuple[EntryView, ...]


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
        binding=service.database.binding(run.id) if whole else "",
        round=run.round,
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
            finished=moment(run.finished),
            own=run.id if run.owner == person_id else "",
        )
        for run in service.database.finished()
    ]


def round_view(service: Service, round: Round, person_id: str) -> RoundView:
    """A round for one of those who take part in it."""
    runs = {run.id: run for run in service.database.in_round(round.id)}
    phase = rounds.phase(round, runs.values())
    if phase == "open":
        counting = service.counted(round)
        names = {person.id: person.name for person in service.database.people()}
        entries = [HandIn(owner, run.id, names.get(owner, ""), run.name) for owner, run in counting.items()]
        runs = {run.id: run for run in counting.values()}
        mine = tuple(run.id for run in service.database.handed_in(round, person_id))
    else:
        entries, mine = service.database.entries(round.id), ()
    places = rounds.places(runs.values()) if phase == "final" else {}
    rows = [_entry(entry, runs.get(entry.run), phase, places.get(entry.run), person_id) for entry in entries]
    return RoundView(
        id=round.id,
        name=round.name,
        phase=phase,
        opened=moment(round.opened),
        closes=moment(round.closes),
        closed="" if round.closed is None else moment(round.closed),
        bits=round.bits if phase == "final" else "",
        chosen=next((entry.run for entry in entries if entry.owner == person_id), ""),
        own=mine,
        failed=sum(run.state is State.FAILED for run in runs.values()),
        entries=tuple(sorted(rows, key=_rank)),
    )


def _entry(entry: HandIn, run: Submission | None, phase: rounds.Phase, place: int | None, person_id: str) -> EntryView:
    mine = entry.run if entry.owner == person_id else ""
    if run is None:
        return EntryView(None, entry.name, entry.person, "deleted", None, None)
    if phase == "open":
        return EntryView(
            None, entry.name, entry.person, "provisional", run.cost, run.holds, remark=run.remark, run=mine
        )
    if run.state is State.VERIFYING:
        return EntryView(None, entry.name, entry.person, "verifying", run.cost, run.holds, run=mine)
    failed = run.state is State.FAILED
    told = EntryView(
        place=place,
        name=entry.name,
        person=entry.person,
        state="not verified" if failed or run.drawn_cost is None else "verified",
        cost=run.cost,
        holds=run.holds,
        run=mine,
    )
    # Who is verified first learns no more than the others: the whole table comes at a time.
    if phase != "final":
        return told
    return replace(
        told,
        drawn_cost=run.drawn_cost,
        drawn_holds=run.drawn_holds,
        remark=f"not verified: {run.reason}" if failed else run.drawn_remark,
        deviations=run.deviations,
        certificate="" if run.drawn_cost is None else f"{run.id}.json",
    )


def _rank(row: EntryView) -> tuple[bool, int, bool, bool, bool, float, str]:
    """Places first, then by V on the published list, then by name; what is deleted last."""
    place = (row.place is None, row.place or 0)
    return *place, row.state == "deleted", bool(row.remark), row.holds is not True, row.cost or 0.0, row.person


def round_csv(view: RoundView) -> str:
    """The table of a round as CSV."""
    return csv_text(EntryView.__struct_fields__, map(astuple, view.entries))


def moment(seconds: float) -> str:
    """A time as text, in UTC."""
    return datetime.fromtimestamp(seconds, timezone.utc).strftime("%Y-%m-%d %H:%M:%S")


def shown_cost(value: float | None) -> str:
    """V for people."""
    return "–" if value is None else f"{value:.1f}"


def state_words(run: Submission) -> str:
    """Where a run is, in words."""
    waits = run.state in (State.CHECKING, State.QUICK, State.EVALUATING, State.VERIFYING) and not run.running
    return ("waits for its " if waits else "") + STATE_WORDS[run.state]
