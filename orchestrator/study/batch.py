"""Running a batch: what is in the store is found there, the rest becomes jobs, and outcomes become results."""

from __future__ import annotations

import logging
import math
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
from ..loop.behaviour import CarryOver, carry_over
from ..loop.trajectory import Status
from ..pairing.pairing import GROUP_SIZE, Pairing, beginning_job, digest_job, judge_job, record_job
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
    """An entry whose cases are on their way: the runs so far by number.

    Failures are counted in the order of the cases, up to the first one that is not there yet, and not in that of
    arrival: an FMU whose calls fail at a certain time was told by another list of cases in each run, and with another
    exit code. ``counted`` is how many cases have been looked at, ``strikes`` what they came to.
    """

    entry: BatchEntry
    keys: list[str]
    runs: dict[int, CaseRun]
    strikes: Counter[tuple[Status, str]] = field(default_factory=Counter)
    counted: int = 0
    reason: str = ""
    """Why no more cases are run; empty while they are."""

    def __post_init__(self) -> None:
        failure = self.entry.first_sample_failure
        if self.entry.patience is not None and failure is not None:
            self.reason = f"skipped after a failure in the first sample ({failure.result.status.value}: {failure.kind})"

    @property
    def waiting(self) -> list[int]:
        return [number for number in range(len(self.keys)) if number not in self.runs]

    @property
    def skipped(self) -> list[int]:
        """The cases that are told as skipped: also those behind the last failure that counts whose runs are there, such
        as from another process or an earlier run. These stay in the store."""
        if not self.reason:
            return self.waiting
        failure = self.entry.first_sample_failure
        return [
            n for n in range(self.counted, len(self.keys)) if failure is None or self.entry.cases[n] != failure.case
        ]

    def take(self, number: int, run: CaseRun) -> None:
        self.runs[number] = run
        patience = self.entry.patience
        while patience is not None and not self.reason and self.counted in self.runs:
            counted = self.runs[self.counted]
            self.counted += 1
            status, kind = failure = counted.result.status, counted.kind
            self.strikes[failure] += 1
            count = self.strikes[failure]
            if kind and count >= (min(patience, TIMEOUTS) if status is Status.TIMEOUT else patience):
                failures = "a failure" if count == 1 else f"{count} failures of one kind"
                self.reason = f"skipped after {failures} ({status.value}: {kind})"


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
    ``repeat`` is to run a case of each process once more behind its others, the first group's in whole, and of the
    other groups' its beginning; raises :class:`StatePasses` if the figures differ there.
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

    def keep(progress: _Progress, number: int, finished: CaseRun) -> None:
        stored.keep(store, progress.keys[number], finished, progress.entry.pairing)

    for progress in opened:
        for finished in list(progress.runs.values()):
            tell(finished)
    for progress in opened:
        failure = progress.entry.first_sample_failure
        if failure is not None and failure.case in progress.entry.cases and progress.entry.patience is not None:
            number = progress.entry.cases.index(failure.case)
            if number not in progress.runs:
                keep(progress, number, failure)
                progress.take(number, failure)
                tell(failure)
    for progress, number, finished in _simulated(opened, execute, _Chatter(first), keep, repeat):
        progress.take(number, finished)
        tell(finished)
    for progress in opened:
        for number in progress.skipped:
            case = progress.entry.cases[number]
            skipped = Judgement(status=Status.SKIPPED, time=0.0, message=progress.reason)
            told = number in progress.runs
            progress.runs[number] = CaseRun(case, case_result(case, skipped))
            if not told:
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


@dataclass
class _Repetition:
    """The first case of a group in one process, of the ``numbers`` of ``progress``, repeated there behind all others,
    as a ``whole`` or only its beginning; ``alone`` is the job that runs it in a fresh process."""

    progress: _Progress
    numbers: Sequence[int]
    alone: Job
    whole: bool
    first: bytes | None = None
    seen: bool = False

    @property
    def over(self) -> bool:
        return self.seen or bool(self.progress.reason)

    def look(self, index: int, outcome: Outcome, execute: Execute) -> None:
        """A case of the group has come to its ``outcome``; raises :class:`StatePasses` if others have changed it."""
        if index == 0:
            self.first = self._figures(outcome)
        # The first case again, in a process that has run all others: if
        # these have left something behind, it shows here.
        elif index == len(self.numbers):
            self.seen, after = True, self._figures(outcome)
            if after is not None and self.first is not None:
                carried = carry_over(after, self.first, lambda: self._again(execute))
                if carried is not CarryOver.NONE:
                    raise StatePasses(self.progress.entry.pairing, carried)

    def _again(self, execute: Execute) -> bytes | None:
        with closing(execute([self.alone])) as outcomes:
            return next((self._figures(outcome) for _, outcome in outcomes), None)

    def _figures(self, outcome: Outcome) -> bytes | None:
        """What the case came to, with its signals, without the text, in which an FMU may say what it wants; of a
        beginning, its signals; None if its process failed."""
        if not isinstance(outcome, Done):
            return None
        value: Simulated | Digested | bytes = outcome.value
        if isinstance(value, bytes):
            return value
        # Figures alone would miss state that moves no worst case.
        signals = value.digest if isinstance(value, Digested) else digest(value.trajectory)
        return pack(structs.replace(value.judgement, message="")) + signals if self.whole else signals


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
    opened: Sequence[_Progress],
    execute: Execute,
    chatter: _Chatter,
    keep: Callable[[_Progress, int, CaseRun], None],
    repeat: bool = False,
) -> Iterator[tuple[_Progress, int, CaseRun]]:
    """The runs of what is waiting, as they come, until no entry wants more; each is given to ``keep``, those of a group
    that repeats a case together, once nothing more is to be seen of it."""
    jobs: list[Job] = []
    repetitions: dict[int, _Repetition] = {}
    # Kept as they came, those of a group that was interrupted before its repetition were found
    # again by a run that had nothing left to compare them with: a wrong score without a word.
    held: dict[int, list[tuple[_Progress, int, CaseRun]]] = {}
    places: list[tuple[_Progress, list[int], set[int]]] = []
    for progress in opened:
        waiting = [] if progress.reason else progress.waiting
        left = set(waiting)
        for numbers in _groups(progress.entry, waiting, least=1 if repeat or len(opened) > 1 else 2):
            job, repetition = _job(progress, numbers, repeat, not repetitions)
            if repetition is not None:
                repetitions[len(jobs)] = repetition
            jobs.append(job)
            places.append((progress, numbers if repetition is None else list(repetition.numbers), left))
    if not jobs:
        return
    with closing(execute(jobs)) as outcomes:
        for number_of_job, outcome in outcomes:
            current, numbers, left = places[number_of_job]
            if number_of_job in repetitions:
                repetitions[number_of_job].look(outcome.index, outcome, execute)
            if outcome.index < len(numbers):
                number = numbers[outcome.index]
                if number in left and not current.reason:  # a cluster may run a job twice
                    left.remove(number)
                    chatter.listen(outcome, current.entry.pairing)
                    run = case_run(current.entry.cases[number], outcome)
                    value = outcome.value if isinstance(outcome, Done) else None
                    if current.entry.witness is not None and isinstance(value, Simulated):
                        current.entry.witness(run.case, run.result, value.trajectory)
                    if number_of_job in repetitions:
                        held.setdefault(number_of_job, []).append((current, number, run))
                    else:
                        keep(current, number, run)
                    yield current, number, run
            for over in [job for job in held if repetitions[job].over]:
                for seen in held.pop(over):
                    keep(*seen)
            compared = all(repetition.over for repetition in repetitions.values())
            if compared and all(progress.reason or not left for progress, _, left in places):
                return
    for runs in held.values():  # whose process did not come to its repetition
        for seen in runs:
            keep(*seen)


def _groups(entry: BatchEntry, waiting: list[int], least: int) -> Iterator[list[int]]:
    """The numbers of the cases that share a job, in at ``least`` so many groups, one of which may be of one case."""
    # Candidates of a tuning run whole in one process each: after one failure the rest of it is not wanted. It must stay
    # in the order of the cases, in which failures are counted.
    count = 1 if entry.patience == 1 else max(math.ceil(len(waiting) / GROUP_SIZE), least)
    # Groups of one size, and of several an even number: with 9, 9 and 6 cases one of two processors
    # waited for the last group. Not by the number of processors: state that passes shows by groups.
    count += count % 2 if count > 1 else 0
    size = max(1, math.ceil(len(waiting) / count))
    return (waiting[first : first + size] for first in range(0, len(waiting), size))


def _job(progress: _Progress, numbers: list[int], repeat: bool, is_first: bool) -> tuple[Job, _Repetition | None]:
    """The job of a group of cases, and how its first case is repeated, if it is.

    Of the group that ``is_first`` a long case is repeated, which takes as long as another case. But state may be set by
    what the first nine cases do not have, such as a long simulation at another pose, and gave a wrong score without a
    word. So the first case of every other group is repeated, too, but only its beginning, for some 1 % of the time.
    """
    entry = progress.entry
    several = len(numbers) > 1 and _shares(entry.pairing)
    alone = entry.patience == 1
    if not (several and repeat and (is_first or entry.witness is None)):
        cases = [entry.cases[number] for number in numbers]
        ask = record_job if entry.witness is not None else judge_job
        return replace(ask(entry.protocol, cases, entry.pairing), give_up=alone), None
    if not is_first:
        job = beginning_job(entry.protocol, [entry.cases[number] for number in numbers], entry.pairing)
        return replace(job, give_up=alone), _Repetition(progress, numbers, job.rest(len(numbers)), whole=False)
    # What gives up after a failure must run in the order in which failures are counted.
    numbers = numbers if alone else _telling_case_first(entry, numbers)
    cases = [entry.cases[number] for number in numbers]
    ask = record_job if entry.witness is not None else digest_job
    job = ask(entry.protocol, [*cases, cases[0]], entry.pairing)
    only = ask(entry.protocol, cases[:1], entry.pairing)
    return replace(job, give_up=alone), _Repetition(progress, numbers, only, whole=True)


def _telling_case_first(entry: BatchEntry, numbers: Sequence[int]) -> list[int]:
    """The numbers of a group, with a long case in front whose criteria show what becomes of its controller."""
    first = max(
        numbers, key=lambda number: (bool(entry.cases[number].test.criteria), entry.cases[number].scenario.duration)
    )
    # A controller that counts its instances, or knows the pose, gave other numbers in every case but the first.
    return [first, *(number for number in numbers if number != first)]


def _shares(pairing: Pairing) -> bool:
    """Whether the cases of a group run in one process."""
    return not pairing.is_separate and not pairing.isolated
