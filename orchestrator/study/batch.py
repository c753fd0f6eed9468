"""Running a batch: what is in the store is found there, the rest becomes jobs, and outcomes become results."""

from __future__ import annotations

import logging
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field, replace

from msgspec import structs

from ..benchmark.metrics import case_result
from ..benchmark.results import Judgement
from ..codec import pack
from ..execution.job import MANY_LOGGED, Done, Job, Outcome
from ..execution.store import Store
from ..loop.carry_over import CarryOver, carry_over
from ..loop.trajectory import Status
from ..pairing.pairing import GROUP_SIZE, Pairing, digest_job, judge_job, record_job
from ..pairing.runs import CaseRun, case_run
from ..pairing.work import Digested, Simulated, digest
from . import stored
from .requests import TIMEOUTS, Batch, BatchEntry

logger = logging.getLogger(__name__)

Execute = Callable[[Sequence[Job]], Generator[tuple[int, Outcome], None, None]]
"""Runs jobs somewhere; yields (number of the job, outcome) as they come."""

OnRun = Callable[[CaseRun, int, int], None]
"""Called with each run as it arrives, the number of runs so far, and their total number."""


@dataclass
class _Progress:
    """An entry whose cases are on their way: the runs so far by number, and the strikes."""

    entry: BatchEntry
    keys: list[str]
    runs: dict[int, CaseRun]
    strikes: Counter[tuple[Status, str]] = field(default_factory=Counter)

    @property
    def waiting(self) -> list[int]:
        return [number for number in range(len(self.keys)) if number not in self.runs]

    @property
    def reason(self) -> str:
        """Why no more cases are run; empty while they are."""
        patience, failure = self.entry.patience, self.entry.first_sample_failure
        if patience is None:
            return ""
        if failure is not None:
            return f"skipped after a failure in the first sample ({failure.result.status.value}: {failure.kind})"
        for (status, kind), count in self.strikes.items():
            if kind and count >= (min(patience, TIMEOUTS) if status is Status.TIMEOUT else patience):
                failures = "a failure" if count == 1 else f"{count} failures of one kind"
                return f"skipped after {failures} ({status.value}: {kind})"
        return ""

    def take(self, number: int, run: CaseRun) -> None:
        self.runs[number] = run
        self.strikes[run.result.status, run.kind] += 1


class StatePasses(Exception):
    """A case that ran after others has other figures than in a fresh process: such runs of this ``pairing`` are of no
    use. ``carry_over`` says why."""

    def __init__(self, pairing: Pairing, carry_over: CarryOver) -> None:
        super().__init__(carry_over.value)
        self.pairing, self.carry_over = pairing, carry_over


def run(
    batch: Batch,
    execute: Execute,
    store: Store,
    on_run: OnRun | None = None,
    first: bool = True,
    repeat: bool = False,
) -> list[list[CaseRun]]:
    """The runs of each entry's cases, in their order; a run depends on its case and the FMUs alone.

    Of the ``first`` batch of a command it is said how much of it is stored already: a search has hundreds. To
    ``repeat`` is to run one case that comes after others a second time, in a fresh process; raises
    :class:`StatePasses` if its figures differ there.
    """
    opened = [_open(entry, store) for entry in batch.entries]
    there = sum(len(progress.runs) for progress in opened)
    total = sum(len(progress.keys) for progress in opened) if batch.total is None else batch.total
    if there and first and on_run is not None and store.lasting:
        logger.info("%d of %d cases are there from an earlier run", there, total, extra={"what": "stored"})
    done = batch.before

    def tell(run: CaseRun) -> None:
        nonlocal done
        done += 1
        if on_run is not None:
            on_run(run, done, total)

    for progress in opened:
        for finished in list(progress.runs.values()):
            tell(finished)
    for progress in opened:
        failure = progress.entry.first_sample_failure
        if failure is not None and failure.case in progress.entry.cases and progress.entry.patience is not None:
            number = progress.entry.cases.index(failure.case)
            if number not in progress.runs:
                _keep(progress, number, failure, store)
                tell(failure)
    for progress, number, finished in _simulated(opened, execute, _Chatter(first), repeat):
        _keep(progress, number, finished, store)
        tell(finished)
    for progress in opened:
        for number in progress.waiting:
            case, skipped = (
                progress.entry.cases[number],
                Judgement(status=Status.SKIPPED, time=0.0, message=progress.reason),
            )
            progress.runs[number] = CaseRun(case, case_result(case, skipped))
            tell(progress.runs[number])
    return [[progress.runs[number] for number in range(len(progress.keys))] for progress in opened]


def _open(entry: BatchEntry, store: Store) -> _Progress:
    keys = stored.keys(entry.protocol, entry.cases, entry.pairing)
    if entry.force:
        store.forget(keys)
    stored_runs = stored.load(store, keys, entry.protocol, entry.cases, entry.pairing, entry.patience is not None)
    progress = _Progress(entry, keys, {})
    for number, run in stored_runs.items():
        progress.take(number, run)
    return progress


def _keep(progress: _Progress, number: int, run: CaseRun, store: Store) -> None:
    stored.keep(store, progress.keys[number], run, progress.entry.pairing)
    progress.take(number, run)


@dataclass
class _Repetition:
    """The first case of a group in one process, of the ``numbers`` of ``progress``, repeated there behind all others;
    ``alone`` is the job that runs it in a fresh process."""

    progress: _Progress
    numbers: Sequence[int]
    alone: Job
    first: bytes | None = None
    over: bool = False

    def look(self, index: int, outcome: Outcome, execute: Execute) -> None:
        """A case of the group has come to its ``outcome``; raises :class:`StatePasses` if others have changed it."""
        if index == 0:
            self.first = _figures(outcome)
        # The first case again, in a process that has run all others: if
        # these have left something behind, it shows here.
        elif index == len(self.numbers):
            self.over, after = True, _figures(outcome)
            if after is not None and self.first is not None:
                carried = carry_over(after, self.first, lambda: self._again(execute))
                if carried is not CarryOver.NONE:
                    raise StatePasses(self.progress.entry.pairing, carried)

    def _again(self, execute: Execute) -> bytes | None:
        with closing(execute([self.alone])) as outcomes:
            return next((_figures(outcome) for _, outcome in outcomes), None)


def _figures(outcome: Outcome) -> bytes | None:
    """What a case came to, with its signals, without the text, in which an FMU may say what it wants; None if its
    process failed."""
    if not isinstance(outcome, Done):
        return None
    value: Simulated | Digested = outcome.value
    # Figures alone would miss state that moves no worst case.
    signals = value.digest if isinstance(value, Digested) else digest(value.trajectory)
    return pack(structs.replace(value.judgement, message="")) + signals


@dataclass
class _Chatter:
    """Says once of a batch that its FMUs log so much that it takes time, if that is ``due``."""

    due: bool

    def listen(self, outcome: Outcome, pairing: Pairing) -> None:
        if self.due and isinstance(outcome, Done) and outcome.logged > MANY_LOGGED:
            self.due = False
            message = "%s logged %.1f million messages in a simulation, which takes time: switch its logging off."
            logger.warning(message, pairing.controller.name, outcome.logged / 1e6)


def _simulated(
    opened: Sequence[_Progress], execute: Execute, chatter: _Chatter, repeat: bool = False
) -> Iterator[tuple[_Progress, int, CaseRun]]:
    """The runs of what is waiting, as they come, until no entry wants more."""
    jobs: list[Job] = []
    repetition, repeated = None, -1
    places: list[tuple[_Progress, list[int], set[int]]] = []
    for progress in opened:
        waiting = [] if progress.reason else progress.waiting
        alone, left = progress.entry.patience == 1, set(waiting)
        # Candidates of a tuning run whole in one process each: after one failure the rest of it is not wanted.
        size = max(1, len(waiting)) if alone else GROUP_SIZE
        for first in range(0, len(waiting), size):
            numbers = waiting[first : first + size]
            entry, several = progress.entry, len(numbers) > 1 and _shares(progress.entry.pairing)
            again = several and repeat and repetition is None
            numbers = _longest_first(entry, numbers) if again else numbers
            cases = [entry.cases[number] for number in numbers]
            ask = record_job if entry.witness is not None else digest_job if again else judge_job
            if again:
                repetition = _Repetition(progress, numbers, ask(entry.protocol, cases[:1], entry.pairing))
                repeated, cases = len(jobs), [*cases, cases[0]]
            jobs.append(replace(ask(entry.protocol, cases, entry.pairing), give_up=alone))
            places.append((progress, numbers, left))
    if not jobs:
        return
    with closing(execute(jobs)) as outcomes:
        for job, outcome in outcomes:
            current, numbers, left = places[job]
            if job == repeated and repetition is not None:
                repetition.look(outcome.index, outcome, execute)
            if outcome.index < len(numbers):
                number = numbers[outcome.index]
                if number in left and not current.reason:  # a cluster may run a job twice
                    left.remove(number)
                    chatter.listen(outcome, current.entry.pairing)
                    run = case_run(current.entry.cases[number], outcome)
                    value = outcome.value if isinstance(outcome, Done) else None
                    if current.entry.witness is not None and isinstance(value, Simulated):
                        current.entry.witness(run.case, run.result, value.trajectory)
                    yield current, number, run
            compared = repetition is None or repetition.over or repetition.progress.reason
            if compared and all(progress.reason or not left for progress, _, left in places):
                return


def _longest_first(entry: BatchEntry, numbers: Sequence[int]) -> list[int]:
    """The numbers of a group, with a long case in front whose criteria show what becomes of its controller."""
    first = max(
        numbers, key=lambda number: (bool(entry.cases[number].test.criteria), entry.cases[number].scenario.duration)
    )
    # A controller that counts its instances, or knows the pose, gave other numbers in every case but the first.
    return [first, *(number for number in numbers if number != first)]


def _shares(pairing: Pairing) -> bool:
    """Whether the cases of a group run in one process."""
    return not pairing.is_separate and not pairing.isolated
