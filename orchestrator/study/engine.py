"""The engine that runs any study: it owns all effects.

Processes or cluster, the store with what is finished, files, recordings, the clock, and whom to tell what happens.
"""

from __future__ import annotations

import functools
import logging
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from datetime import datetime, timezone
from pathlib import Path
from typing import Any, TypeVar

from ..asking import answered
from ..documents import recording
from ..documents.files import prepare_folder, remove, write_text
from ..errors import InputError
from ..execution import cluster, pool, store
from ..execution.sandbox_probe import leaks
from ..pairing.runs import CaseRun
from ..pairing.testbed import Testbed
from . import batch, rehearsal
from .batch import Execute, OnRun
from .dry_run import Plan, plan
from .processes import Processes
from .recorder import record_shown
from .requests import (
    Batch,
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
)

T = TypeVar("T")

logger = logging.getLogger(__name__)

OnEvent = Callable[[Event], None]
"""Called with each event of a study."""


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

    def plan(self, study: Requests[Any]) -> Plan:
        """What ``study`` would run, without running it; nothing is written."""
        return plan(study, self.execute, self.processes, self.folder)

    def run(self, study: Requests[T]) -> T:
        """The document of ``study``. The folder is first touched when the study, which has checked its input by then,
        asks for something; what is finished is kept however this ends."""
        spent = _Spent()
        with ExitStack() as stack:

            @functools.cache
            def known() -> store.Store:
                if self.folder is not None:
                    prepare_folder(self.folder)
                return stack.enter_context(store.opened(self.folder))

            processes = Processes()
            found = answered(study, lambda request: self._answer(request, known(), spent, processes))
        for controller in processes.seen.values():
            if added := controller.added():
                message = "%s has left %s in its own folder, where later cases find it: their results may depend on it."
                logger.warning(message, controller.name, added[0], extra={"what": "left-files"})
        return found

    def _answer(self, request: Request, known: store.Store, spent: _Spent, processes: Processes) -> Any:
        match request:
            case Batch():
                found = self._run(request, known, processes, first=not spent.simulations)
                spent.count([run for runs in found for run in runs])
                return found
            case Rehearse(pairing, case, probe):
                rehearsed = rehearsal.rehearse(case, processes.of(pairing, known), probe, compare=probe)
                processes.take(pairing, rehearsed.carry_over, known)
                return rehearsed
            case TimeSteps(pairing, case):
                return rehearsal.computing_time(case, processes.of(pairing, known))
            case Record(pairing, shown):
                return record_shown(shown, processes.of(pairing, known), self.processes)
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
                    begin, time.perf_counter(), self.processes, **vars(spent), carry_over={**processes.found}
                )
            case Tell(event):
                if self.on_event is not None:
                    self.on_event(event)
        return None

    def _run(self, request: Batch, known: store.Store, processes: Processes, first: bool) -> list[list[CaseRun]]:
        """The runs of a batch: all of them again, each in a process of its own, where state passes between them."""
        wanted = processes.batch(request, known)
        repeat = processes.is_due(wanted)
        try:
            found = batch.run(wanted, self.execute, known, self.on_run, first, repeat)
        except batch.StatePasses as passes:
            processes.take(passes.pairing, passes.found, known)
            return self._run(request, known, processes, first)
        processes.count(wanted, repeat)
        return found


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
        found = leaks()
    except InputError as problem:
        logger.warning("The controller runs without a sandbox, and could reach what you can. %s", problem)
        return False
    if found:
        message = f"The sandbox of this machine allows what it must not: {', '.join(found)}. Nothing is certified."
        raise InputError(message, "leaky-sandbox")
    return True
