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
from .requests import TIMEOUTS, Batch, Entry

logger = logging.getLogger(__name__)

Execute = Callable[[Sequence[Job]], Generator[tuple[int, Outcome], None, None]]
"""Runs jobs somewhere; yields (number of the job, outcome) as they come."""

OnRun = Callable[[CaseRun, int, int], None]
"""Called with each run as it arrives, the number of runs so far, and their total number."""


@dataclass
class _Open:
    """An entry whose cases are on their way: the runs so far by number, and the strikes."""

    entry: Entry
    keys: list[str]
    found: dict[int, CaseRun]
    strikes: Counter[tuple[Status, str]] = field(default_factory=Counter)

    @property
    def waiting(self) -> list[int]:
        return [number for number in range(len(self.keys)) if number not in self.found]

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
        self.found[number] = run
        self.strikes[run.result.status, run.kind] += 1


class StatePasses(Exception):
    """A case that ran after others has other figures than in a fresh process: such runs of this ``pairing`` are of no
    use. ``found`` says why."""

    def __init__(self, pairing: Pairing, found: CarryOver) -> None:
        super().__init__(found.value)
        self.pairing, self.found = pairing, found


def run(
    batch: Batch,
    execute: Execute,
    known: Store,
    on_run: OnRun | None = None,
    first: bool = True,
    repeat: bool = False,
) -> list[list[CaseRun]]:
    """The runs of each entry's cases, in their order; a run depends on its case and the FMUs alone.

    Of the ``first`` batch of a command it is said how much of it is known already: a search has hundreds. To
    ``repeat`` is to run one case that comes after others a second time, in a fresh process; raises
    :class:`StatePasses` if its figures differ there.
    """
    opened = [_open(entry, known) for entry in batch.entries]
    there = sum(len(each.found) for each in opened)
    total = sum(len(each.keys) for each in opened) if batch.total is None else batch.total
    if there and first and on_run is not None and known.lasting:
        logger.info("%d of %d cases are there from an earlier run", there, total, extra={"what": "stored"})
    done = batch.before

    def tell(run: CaseRun) -> None:
        nonlocal done
        done += 1
        if on_run is not None:
            on_run(run, done, total)

    for each in opened:
        for found in list(each.found.values()):
            tell(found)
    for each in opened:
        failure = each.entry.first_sample_failure
        if failure is not None and failure.case in each.entry.cases and each.entry.patience is not None:
            number = each.entry.cases.index(failure.case)
            if number not in each.found:
                _keep(each, number, failure, known)
                tell(failure)
    for each, number, found in _simulated(opened, execute, _Chatter(first), repeat):
        _keep(each, number, found, known)
        tell(found)
    for each in opened:
        for number in each.waiting:
            case, skipped = each.entry.cases[number], Judgement(status=Status.SKIPPED, time=0.0, message=each.reason)
            each.found[number] = CaseRun(case, case_result(case, skipped))
            tell(each.found[number])
    return [[each.found[number] for number in range(len(each.keys))] for each in opened]


def _open(entry: Entry, known: Store) -> _Open:
    keys = stored.keys(entry.protocol, entry.cases, entry.pairing)
    if entry.force:
        known.forget(keys)
    found = stored.load(known, keys, entry.protocol, entry.cases, entry.pairing, entry.patience is not None)
    own = _Open(entry, keys, {})
    for number, run in found.items():
        own.take(number, run)
    return own


def _keep(own: _Open, number: int, run: CaseRun, known: Store) -> None:
    stored.keep(known, own.keys[number], run, own.entry.pairing)
    own.take(number, run)


@dataclass
class _Repetition:
    """The first case of a group in one process, of the ``numbers`` of ``own``, repeated there behind all others;
    ``alone`` is the job that runs it in a fresh process."""

    own: _Open
    numbers: Sequence[int]
    alone: Job
    first: bytes | None = None
    over: bool = False

    def look(self, index: int, outcome: Outcome, execute: Execute) -> None:
        """A case of the group has come to its ``outcome``; raises :class:`StatePasses` if others have changed it."""
        if index == 0:
            self.first = _figures(outcome)
        elif index == len(self.numbers):
            self.over, after = True, _figures(outcome)
            if after is not None and self.first is not None:
                found = carry_over(after, self.first, lambda: self._again(execute))
                if found is not CarryOver.NONE:
                    raise StatePasses(self.own.entry.pairing, found)

    def _again(self, execute: Execute) -> bytes | None:
        with closing(execute([self.alone])) as outcomes:
            return next((_figures(outcome) for _, outcome in outcomes), None)


def _figures(outcome: Outcome) -> bytes | None:
    """What a case came to, with its signals, without the text, in which an FMU may say what it wants; None if its
    process failed."""
    if not isinstance(outcome, Done):
        return None
    value: Simulated | Digested = outcome.value
    signals = value.digest if isinstance(value, Digested) else digest(value.trajectory)
    return pack(structs.replace(value.judgement, message="")) + signals


@dataclass
class _Chatter:
    """Says once of a batch that its FMUs log so much that it takes time, if it is ``wanted``."""

    wanted: bool

    def listen(self, outcome: Outcome, pairing: Pairing) -> None:
        if self.wanted and isinstance(outcome, Done) and outcome.logged > MANY_LOGGED:
            self.wanted = False
            message = "%s logged %.1f million messages in a simulation, which takes time: switch its logging off."
            logger.warning(message, pairing.controller.name, outcome.logged / 1e6)


def _simulated(
    opened: Sequence[_Open], execute: Execute, chatter: _Chatter, repeat: bool = False
) -> Iterator[tuple[_Open, int, CaseRun]]:
    """The runs of what is waiting, as they come, until no entry wants more."""
    jobs: list[Job] = []
    repetition, repeated = None, -1
    places: list[tuple[_Open, list[int], set[int]]] = []
    for each in opened:
        waiting = [] if each.reason else each.waiting
        alone, left = each.entry.patience == 1, set(waiting)
        size = max(1, len(waiting)) if alone else GROUP_SIZE
        for first in range(0, len(waiting), size):
            numbers = waiting[first : first + size]
            entry, several = each.entry, len(numbers) > 1 and _shares(each.entry.pairing)
            again = several and repeat and repetition is None
            numbers = _longest_first(entry, numbers) if again else numbers
            cases = [entry.cases[number] for number in numbers]
            ask = record_job if entry.witness is not None else digest_job if again else judge_job
            if again:
                repetition = _Repetition(each, numbers, ask(entry.protocol, cases[:1], entry.pairing))
                repeated, cases = len(jobs), [*cases, cases[0]]
            jobs.append(replace(ask(entry.protocol, cases, entry.pairing), give_up=alone))
            places.append((each, numbers, left))
    if not jobs:
        return
    with closing(execute(jobs)) as outcomes:
        for job, outcome in outcomes:
            own, numbers, left = places[job]
            if job == repeated and repetition is not None:
                repetition.look(outcome.index, outcome, execute)
            if outcome.index < len(numbers):
                number = numbers[outcome.index]
                if number in left and not own.reason:  # a cluster may run a job twice
                    left.remove(number)
                    chatter.listen(outcome, own.entry.pairing)
                    run = case_run(own.entry.cases[number], outcome)
                    value = outcome.value if isinstance(outcome, Done) else None
                    if own.entry.witness is not None and isinstance(value, Simulated):
                        own.entry.witness(run.case, run.result, value.trajectory)
                    yield own, number, run
            compared = repetition is None or repetition.over or repetition.own.reason
            if compared and all(each.reason or not left for each, _, left in places):
                return


def _longest_first(entry: Entry, numbers: Sequence[int]) -> list[int]:
    """The numbers of a group, with a long case in front whose criteria show what becomes of its controller."""
    first = max(
        numbers, key=lambda number: (bool(entry.cases[number].test.criteria), entry.cases[number].scenario.duration)
    )
    return [first, *(number for number in numbers if number != first)]


def _shares(pairing: Pairing) -> bool:
    """Whether the cases of a group run in one process."""
    return not pairing.is_separate and not pairing.isolated
