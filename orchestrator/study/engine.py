"""The engine that runs any study: it owns all effects.

Processes or cluster, the store with what is finished, files, recordings, the clock, and whom to tell what happens. What
a report shows in full is simulated again: a case is deterministic, so this is the very one evaluated. It also finds out
which controllers need a process for each simulation; what is stored remembers it.
"""

from __future__ import annotations

import functools
import hashlib
import logging
import math
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field, replace
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeVar

from ..documents import recording
from ..documents.files import prepare_folder, remove, write_text
from ..documents.recording import Recording
from ..errors import InputError
from ..execution import cluster, pool, store
from ..execution.job import Done
from ..execution.sandbox_probe import leaks
from ..execution.store import Store
from ..fmi.archive import Archive
from ..loop.behaviour import WORDS, CarryOver
from ..pairing import work
from ..pairing.pairing import GROUP_SIZE, START_TIME, Pairing
from ..pairing.runs import CaseRun
from ..pairing.testbed import Testbed
from . import batch, rehearsal
from .batch import Execute, OnRun
from .dry_run import DryRun, plan
from .requests import (
    Batch,
    CaseToShow,
    Event,
    Instant,
    Now,
    OwnFile,
    Record,
    Rehearse,
    Request,
    Requests,
    Save,
    Tell,
    TimeSteps,
    Write,
    answered,
)

REPEAT_EVERY = 100
"""Simulations of which one is repeated in a fresh process, beside one of the first batch."""

logger = logging.getLogger(__name__)


@dataclass
class Processes:
    """The controllers ``seen`` and the ``carry_over`` of each, by the SHA-256 of its bytes; and how many of its
    simulations shared processes: ``grouped`` in all, ``repeated`` when one was last repeated."""

    carry_over: dict[str, CarryOver] = field(default_factory=dict)
    seen: dict[str, Archive] = field(default_factory=dict)
    grouped: dict[str, int] = field(default_factory=dict)
    repeated: dict[str, int] = field(default_factory=dict)

    def of(self, pairing: Pairing, store: Store) -> Pairing:
        """The ``pairing`` as it has to be run; an earlier run, with results in the ``store``, may have shown that."""
        key = pairing.controller.sha256
        self.seen[key] = pairing.controller
        if key not in self.carry_over and (record := store.get([_key(pairing)])):
            with suppress(ValueError):  # a record that makes no sense is none
                self.carry_over[key] = CarryOver(record[_key(pairing)].decode())
        separate = self.carry_over.get(key, CarryOver.NOT_TESTED).separates and not pairing.isolated
        return replace(pairing, separate=True) if separate else pairing

    def batch(self, batch: Batch, store: Store) -> Batch:
        """The ``batch`` as it has to be run."""
        return replace(
            batch, entries=tuple(replace(entry, pairing=self.of(entry.pairing, store)) for entry in batch.entries)
        )

    def is_due(self, batch: Batch) -> bool:
        """Whether a case of ``batch`` is to be repeated."""
        keys = {entry.pairing.controller.sha256 for entry in batch.entries}
        return any(
            key not in self.repeated or self.grouped.get(key, 0) - self.repeated[key] >= REPEAT_EVERY for key in keys
        )

    def count(self, batch: Batch, repeated: bool) -> None:
        """A ``batch`` has been run."""
        for entry in batch.entries:
            key = entry.pairing.controller.sha256
            if repeated:
                self.repeated[key] = self.grouped.get(key, 0)
            if not entry.pairing.is_separate:
                self.grouped[key] = self.grouped.get(key, 0) + len(entry.cases)

    def take(self, pairing: Pairing, carry_over: CarryOver, store: Store) -> None:
        """What repeating has shown of a pairing's controller, also for a later run that finds the same results.

        Raises :class:`InputError` if results of it have been used already that may be wrong.
        """
        key = pairing.controller.sha256
        if carry_over is CarryOver.NOT_TESTED:
            return
        self.carry_over[key] = carry_over
        if not carry_over.separates:
            return
        store.put(_key(pairing), pairing.controller.name, carry_over.value.encode())
        what = f"{pairing.controller.name}: {WORDS[carry_over]}"
        # They may be in documents that were saved; nothing but beginning anew makes them right.
        if self.grouped.get(key):
            message = f"{what}. This was found after {self.grouped[key]} simulations, whose results may be wrong."
            raise InputError(message, "state-passes", pairing.controller.name)
        logger.warning("%s. Each simulation has a process of its own.", what)


def _key(pairing: Pairing) -> str:
    """The key of what is stored of a controller: not that of a case."""
    return hashlib.sha256(f"carry-over {pairing.controller.sha256} {pairing.controller.library}".encode()).hexdigest()


T = TypeVar("T")


OnEvent = Callable[[Event], None]
"""Called with each event of a study."""


MAX_RECORDING_BYTES = 1 << 22
"""Bytes of the largest recording, whose signals are thinned out."""


@dataclass
class _Spent:
    """What simulations have taken so far, as in :class:`.Instant`."""

    simulations: int = 0
    simulated_time: float = 0.0
    simulation_time: float = 0.0

    def count(self, runs: Sequence[CaseRun]) -> None:
        self.simulations += len(runs)
        self.simulated_time += sum(run.result.time for run in runs)
        self.simulation_time += sum(run.wall_time for run in runs)


@dataclass(frozen=True)
class Engine:
    """What answers the requests of a study.

    ``folder`` is where finished cases are stored as they come and found again, and where documents are saved; None for
    neither.
    """

    execute: Execute
    processes: int
    folder: Path | None = None
    on_run: OnRun | None = None
    on_event: OnEvent | None = None

    def plan(self, study: Requests[Any]) -> DryRun:
        """What ``study`` would run, without running it; nothing is written."""
        return plan(study, self.execute, self.processes, self.folder)

    def run(self, study: Requests[T]) -> T:
        """The document of ``study``. The folder is first touched when the study, which has checked its input by then,
        asks for something; what is finished is kept however this ends."""
        spent = _Spent()
        with ExitStack() as stack:

            @functools.cache
            def finished() -> store.Store:
                if self.folder is not None:
                    prepare_folder(self.folder)
                return stack.enter_context(store.opened(self.folder))

            processes = Processes()
            document = answered(study, lambda request: self._answer(request, finished(), spent, processes))
        for controller in processes.seen.values():
            # What a controller writes beside itself reaches the next case without a process that they share.
            if added := controller.added():
                message = "%s has left %s in its own folder, where later cases find it: their results may depend on it."
                logger.warning(message, controller.name, added[0], extra={"what": "left-files"})
        return document

    def _answer(self, request: Request, finished: store.Store, spent: _Spent, processes: Processes) -> Any:
        match request:
            case Batch():
                by_entry = self._run(request, finished, processes, first=not spent.simulations)
                spent.count([run for runs in by_entry for run in runs])
                return by_entry
            case Rehearse(pairing, case, probe):
                rehearsed = rehearsal.rehearse(case, processes.of(pairing, finished), probe, compare=probe)
                processes.take(pairing, rehearsed.carry_over, finished)
                return rehearsed
            case TimeSteps(pairing, case):
                return rehearsal.computing_time(case, processes.of(pairing, finished))
            case Record(pairing, shown):
                return record_shown(shown, processes.of(pairing, finished), self.processes)
            case Save(document, inside, recordings):
                if self.folder is not None:
                    document.save(self.folder / inside)
                    if recordings:
                        recording.save(recordings, self.folder / inside)
            case Write(name, text):
                if self.folder is not None:
                    remove(self.folder / name) if text is None else write_text(self.folder / name, text)
            case OwnFile(name):
                return None if self.folder is None else self.folder / name
            case Now():
                begin = datetime.now(timezone.utc).isoformat(timespec="seconds")
                return Instant(
                    begin, time.perf_counter(), self.processes, **vars(spent), carry_over={**processes.carry_over}
                )
            case Tell(event):
                if self.on_event is not None:
                    self.on_event(event)
        return None

    def _run(self, request: Batch, finished: store.Store, processes: Processes, first: bool) -> list[list[CaseRun]]:
        """The runs of a batch: all of them again, each in a process of its own, where state passes between them."""
        due = processes.batch(request, finished)
        repeat = processes.is_due(due)
        try:
            by_entry = batch.run(due, self.execute, finished, self.on_run, first, repeat)
        except batch.StatePasses as passes:
            processes.take(passes.pairing, passes.carry_over, finished)
            return self._run(request, finished, processes, first)
        processes.count(due, repeat)
        return by_entry


def local_executor(testbed: Testbed) -> Execute:
    """Runs jobs in processes of this machine."""
    return functools.partial(pool.run, workers=testbed.processes)


def chosen_executor(testbed: Testbed) -> Execute:
    """Runs jobs in processes of this machine, or on the scheduler's."""
    if testbed.scheduler:
        return functools.partial(cluster.run, address=testbed.scheduler, wait=testbed.wait)
    return local_executor(testbed)


def can_fence() -> bool:
    """Whether there is a sandbox here; a note says if not.

    Raises :class:`InputError` for one in which something works that must not.
    """
    try:
        leaking = leaks()
    except InputError as problem:
        logger.warning("The controller runs without a sandbox, and could reach what you can. %s", problem)
        return False
    if leaking:
        message = f"The sandbox of this machine allows what it must not: {', '.join(leaking)}. Nothing is certified."
        raise InputError(message, "leaky-sandbox")
    return True


def record_shown(shown: Sequence[CaseToShow], pairing: Pairing, workers: int) -> tuple[Recording, ...]:
    """Simulate what a report shows, on ``workers`` processes.

    What fails before its first sample, or takes its process with it, is left out: its status stands in the results.
    """

    def checked(group: Sequence[CaseToShow]) -> Callable[[int, bytes], Recording]:
        return lambda index, value: work.recording(group[index].case, group[index].roles, value)

    count = max(workers, math.ceil(len(shown) / GROUP_SIZE))
    groups = [group for first in range(count) if (group := shown[first::count])]
    jobs = [
        pairing.job(
            work.record_case.__name__,
            [work.RecordTask(pairing.setup, to_show.case, to_show.roles) for to_show in group],
            [to_show.case.scenario for to_show in group],
            checked(group),
            START_TIME,
            MAX_RECORDING_BYTES,
        )
        for group in groups
    ]
    recordings: dict[int, Recording] = {}
    with closing(pool.run(jobs, workers)) as outcomes:
        for number, outcome in outcomes:
            if isinstance(outcome, Done):
                recordings[number + outcome.index * count] = outcome.value
    return tuple(recordings[number] for number in sorted(recordings))
