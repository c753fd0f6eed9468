"""The requests of a study, and their answers.

A study is a generator: it yields requests, is sent the answers, and returns its document. What goes wrong in answering
is raised where it has asked. It has no effects of its own: it can be tried with any function that answers, and one
study can be part of another with ``yield from``.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar
from typing import Protocol as Interface

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from ..documents.recording import Recording
from ..errors import Crash
from ..loop.behaviour import CarryOver
from ..loop.trajectory import Trajectory
from ..pairing.pairing import Pairing
from ..pairing.runs import CaseRun
from ..search.candidates import Trial
from .rehearsal import Rehearsal

Asked = TypeVar("Asked")
Other = TypeVar("Other")
T = TypeVar("T")


def answered(asking: Generator[Asked, Any, T], answer: Callable[[Asked], Any]) -> T:
    """The result of ``asking`` if ``answer(request)`` answers each of its requests."""
    try:
        request = next(asking)
        while True:
            try:
                reply = answer(request)
            except BaseException as problem:
                request = asking.throw(problem)
            else:
                request = asking.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result


def translated(
    asking: Generator[Asked, Any, T], translate: Callable[[Asked], Generator[Other, Any, Any]]
) -> Generator[Other, Any, T]:
    """The same with requests of another kind: ``translate(request)`` asks for what answers it."""
    try:
        request = next(asking)
        while True:
            try:
                reply = yield from translate(request)
            except BaseException as problem:
                request = asking.throw(problem)
            else:
                request = asking.send(reply)
    except StopIteration as end:
        result: T = end.value
        return result


STRIKES = 3
"""Failures of one kind after which a controller's remaining cases are skipped."""

TIMEOUTS = 2
"""The same of timeouts, each of which costs a whole time limit: together, at most twice the limit of waiting."""


class Saved(Interface):
    """What can be saved in a folder."""

    def save(self, folder: str | Path) -> Path:
        """Write it into ``folder``."""


@dataclass(frozen=True)
class BatchEntry:
    """Cases of one pairing, judged by a protocol.

    After ``patience`` failures of one kind, or TIMEOUTS if these are fewer, the remaining cases are skipped. If it is
    None none is skipped, and what failed in an earlier run is run again; with ``force`` everything is. A failure
    ``first_sample_failure``, which the rehearsal has found, is enough alone. ``witness`` is given each simulated case
    with its result and its trajectory as it comes.
    """

    protocol: Protocol
    pairing: Pairing
    cases: tuple[Case, ...]
    patience: int | None = STRIKES
    force: bool = False
    first_sample_failure: CaseRun | None = None
    witness: Callable[[Case, CaseResult, Trajectory], None] | None = None


@dataclass(frozen=True)
class Batch:
    """Asks for the runs of each entry's cases, in their order: a list of lists of :class:`.CaseRun`.

    Entries with a patience of one failure run side by side, each in one process. For the progress of a study of several
    batches: ``before`` is the number of cases that came before this one, ``total`` that of all.
    """

    entries: tuple[BatchEntry, ...]
    before: int = 0
    total: int | None = None


@dataclass(frozen=True)
class Rehearse:
    """Asks for the :class:`.Rehearsal` of a case, with or without the probe of the controller's timing."""

    pairing: Pairing
    case: Case
    probe: bool = True


@dataclass(frozen=True)
class TimeSteps:
    """Asks for the controller's :class:`.ComputingTime` at the beginning of a case; None if it cannot be measured."""

    pairing: Pairing
    case: Case


@dataclass(frozen=True)
class CaseToShow:
    """A case to simulate again, and what it is shown for."""

    case: Case
    roles: tuple[str, ...]


@dataclass(frozen=True)
class Record:
    """Asks for the recordings of cases that a report shows: a tuple of :class:`.Recording`."""

    pairing: Pairing
    shown: tuple[CaseToShow, ...]


@dataclass(frozen=True)
class Save:
    """Asks for a document and what was recorded for it to be saved in the folder ``inside`` that of the study, if the
    study has one; the answer is None."""

    document: Saved
    inside: str = ""
    recordings: tuple[Recording, ...] = ()


@dataclass(frozen=True)
class Write:
    """Asks for a text file ``name`` in the study's folder, or that there is none if ``text`` is None."""

    name: str
    text: str | None


@dataclass(frozen=True)
class OwnFile:
    """Asks for the path of a file ``name`` in the study's folder that the study keeps itself; None if there is none."""

    name: str


@dataclass(frozen=True)
class Now:
    """Asks for the present :class:`Instant`."""


@dataclass(frozen=True)
class Tell:
    """Tells what has happened, one of the events below; the answer is None."""

    event: Event


@dataclass(frozen=True)
class Instant:
    """A time as text and on a steady clock [s], how many processes there are at a time, and the number of simulations
    that were answered until then with the sums of their simulated time and of what they took [s]; and what is known of
    controllers by the SHA-256 of their bytes."""

    start: str
    seconds: float
    processes: int
    simulations: int = 0
    simulated_time: float = 0.0
    simulation_time: float = 0.0
    carry_over: Mapping[str, CarryOver] = field(default_factory=dict)


@dataclass(frozen=True)
class SeedDone:
    """One of several seeds is evaluated."""

    seed: int
    evaluation: Any


@dataclass(frozen=True)
class CaseChecked:
    """A case of a verification has been computed anew by the second checker; ``content`` is the file ``name`` that it
    has read."""

    name: str
    content: bytes


@dataclass(frozen=True)
class StageDone:
    """A stage of a search has ended, after so many simulations that took ``spent`` whole cases; V found so far, and the
    worst value of each target."""

    stage: str
    simulations: int
    spent: float
    cost: float | None
    worst: Mapping[str, float | None]


@dataclass(frozen=True)
class TrialDone:
    """A candidate is tried, the number ``done`` of ``total``; ``best`` is the best so far in all of the objective's
    cases, None if none has been tried in those that were added last."""

    trial: Trial
    done: int
    total: int
    best: Trial | None = None


Event = SeedDone | StageDone | TrialDone | CaseChecked

OnResult = Callable[[CaseResult, int, int], None]
"""Called with each result as it arrives, the number of results so far, and their total number."""
Request = Batch | Rehearse | TimeSteps | Record | Save | Write | OwnFile | Now | Tell
Requests = Generator[Request, Any, T]
"""The requests of a study, or of a part of one, that returns a ``T``."""


def inside(folder: str, asked: Requests[T]) -> Requests[T]:
    """The requests ``asked`` of a study in a ``folder`` inside that of another one."""

    def moved(request: Request) -> Requests[Any]:
        if isinstance(request, Save):
            request = replace(request, inside="/".join(filter(None, (folder, request.inside))))
        return (yield request)

    return translated(asked, moved)


def rehearsed(pairing: Pairing, case: Case) -> Requests[Rehearsal]:
    """Rehearse a case; raises :class:`Crash` if the process does not come through the first sample."""
    rehearsal: Rehearsal = yield Rehearse(pairing, case)
    if rehearsal.failure is not None:
        raise Crash(rehearsal.failure.result.message)
    return rehearsal


def side_by_side(protocol: Protocol, groups: Sequence[tuple[Pairing, Sequence[Case]]]) -> Batch:
    """Asks for the cases of several pairings; those after one that has no verdict are skipped."""
    return Batch(tuple(BatchEntry(protocol, pairing, tuple(cases), patience=1) for pairing, cases in groups))
