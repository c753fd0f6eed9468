"""Tasks in worker processes. A task that crashes, hangs, or uses too much memory or output affects no other task."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

from msgspec.structs import replace

from ..errors import BenchmarkError, EnvironmentFault
from ..fmi.archive import restore
from ..text import printable
from .job import Died, Done, Job, Outcome
from .launch import EXIT_TIMEOUT, LOST, Child, Process, Stopped, started
from .messages import Garbage, Inbox, readable
from .process_tree import FOREIGN_SIGNALS, end_of
from .standstill import Standstill
from .time_limit import Stopwatch, end_within
from .worker_life import Death, Event, Life, Looked, Printed, ProcessEnded, Received, Remains, died, on

NOT_BY_CONTROLLER = "outside"
"""Code of a fault for which an isolated controller is not to blame: but it has seen its draws, so they are spent."""

TAIL_BYTES = 8192
"""Bytes of a worker's printed output that are kept."""

MAX_LINES = 10
"""Lines that are shown of what a dead worker had printed, and of what the FMUs had logged there."""

POLL_INTERVAL = 0.2
"""Seconds between two looks at the stop signal and at what the worker uses."""

ATTEMPTS = 3
"""Workers that may be lost to faults of the environment before that is given up."""


def run_isolated(job: Job, stop: threading.Event | None = None) -> Iterator[Outcome]:
    """Run the tasks of ``job`` in worker processes and yield one outcome per task, in order; all but those it gives up.

    A task that fails or ends its process costs that task only: the rest goes on in a new worker. One that fails in a
    process that has run others before, or whose process may have been ended by somebody else, gets a second chance in
    a new process: so the outcome does not depend on what ran before. Once ``stop`` is set, the running worker is
    killed and nothing more is yielded. Raises :class:`EnvironmentFault` if this machine keeps workers from running.

    An isolated controller gets no second chance, in which it could use what it has seen. What somebody else may have
    caused is an :class:`EnvironmentFault` then, with the code ``"outside"``.
    """
    stop = stop or threading.Event()
    first, tried, faults = 0, -1, 0
    while first < len(job.tasks) and not stop.is_set():
        try:
            with suppress(Stopped), started(job.rest(first), stop) as child:
                start = first
                for outcome in _listen(child, job.rest(first), stop):
                    number = start + outcome.index
                    if job.isolated:
                        _refuse_outside(outcome, job)
                    elif number != tried and _deserves_another_chance(outcome, job):
                        tried = number
                        break
                    first = number + 1
                    yield replace(outcome, index=number)
                    if job.give_up and not isinstance(outcome, Done):
                        return
        except EnvironmentFault as problem:
            faults += 1
            if job.isolated:
                raise EnvironmentFault(str(problem), NOT_BY_CONTROLLER) from problem
            if faults == ATTEMPTS:
                raise
            restore(job.plant)
            restore(job.controller)


def _refuse_outside(outcome: Outcome, job: Job) -> None:
    if isinstance(outcome, Done):
        return
    if restore(job.plant) | restore(job.controller):
        raise EnvironmentFault("The extracted FMUs have been changed or removed.", NOT_BY_CONTROLLER)
    if isinstance(outcome, Died) and outcome.outside:
        raise EnvironmentFault(outcome.message, NOT_BY_CONTROLLER)


def _deserves_another_chance(outcome: Outcome, job: Job) -> bool:
    if isinstance(outcome, Done):
        return False
    if restore(job.plant) | restore(job.controller):
        return True  # the extracted files were not there, or not as they should be
    if isinstance(outcome, Died):
        if outcome.outside:
            return True
        if outcome.timeout and outcome.place.sample > 0:
            return False  # what ran before may keep an FMU from starting; a hang on the way costs a whole time limit
    return outcome.index > 0


def _listen(child: Child, job: Job, stop: threading.Event) -> Iterator[Outcome]:
    """Outcomes of one worker: until its tasks are done, one fails, or the process dies or has to.

    Raises :class:`EnvironmentFault` for a process that dies before an FMU can have anything to do with it, or that
    reports such a fault itself.
    """
    senses, life = _Senses(child, job), Life()
    while not stop.is_set():
        for event in senses.events():
            before = life
            life, answer = on(before, event, job)
            if isinstance(answer, BenchmarkError):
                raise answer
            if isinstance(answer, Death):
                yield died(life, answer, senses.remains())
            elif isinstance(answer, Standstill):
                job.on_standstill(life.task, answer)
            elif answer is not None:
                yield answer
            if life.over:
                return
            if (life.task, life.loaded) != (before.task, before.loaded):
                senses.watch.begin()


class _Senses:
    """What can be heard and seen of a worker, as events."""

    def __init__(self, child: Child, job: Job) -> None:
        self._child, self._job, self._tail = child, job, b""
        self._inbox, self._sources = Inbox(child.channel, job.largest), [child.channel, child.output]
        self.watch = Stopwatch(child.process.tree)

    def events(self) -> Iterator[Event]:
        """What happens until the next look, each found when it is asked for: what the one before has begun counts."""
        ready = readable(self._sources, POLL_INTERVAL)
        if self._child.output in ready:
            piece = os.read(self._child.output, 65536)
            self._tail = (self._tail + piece)[-TAIL_BYTES:]
            if not piece:
                self._sources.remove(self._child.output)
            yield Printed(len(piece))
        if self._child.channel in ready:
            still_open = self._inbox.receive()
            yield from self._received()
            if not still_open:
                yield _ending(self._child.process, self._job.sandbox)
        if self.watch.age > POLL_INTERVAL:
            use, now = self.watch.look(), time.monotonic()
            code = self._child.process.exit_code(0.0)
            # What is in the channel goes first: a worker may end right after its last result, and did so between the
            # two looks on a busy machine. What it has started may hold the channel open, empty, after its end.
            unread = code is not None and readable([self._child.channel], 0.0)
            end = None if code is None or unread else _cause(code, self._job.sandbox)
            yield Looked(now, use, self.watch.spent, self._child.trace.read(), end)

    def _received(self) -> Iterator[Received]:
        try:
            for message in self._inbox.messages():
                yield Received(message, self._child.trace.logged()[0])
        except Garbage as problem:
            yield Received(problem)

    def remains(self) -> Remains:
        """End the process; what it leaves."""
        self._child.process.kill()
        count, logged = self._child.trace.logged()
        printed = _lines(self._tail + _rest(self._child.output, self._job.limits.output))
        lines = (*printed, *logged[-MAX_LINES:])
        return Remains(self._child.trace.read(), lines, count, self.watch.elapsed)


def _rest(output: int, most: int) -> bytes:
    """What a dead worker had printed last, of at most ``most`` bytes: what it has started may go on printing."""
    data, count = b"", 0
    while count < most and readable([output], 0.0) and (piece := os.read(output, 65536)):
        data, count = (data + piece)[-TAIL_BYTES:], count + len(piece)
    return data


def _lines(tail: bytes) -> tuple[str, ...]:
    return tuple(line[:500] for line in printable(tail).splitlines()[-MAX_LINES:])


def _ending(process: Process, sandboxed: bool) -> ProcessEnded:
    """How a process ends that has closed its channel."""
    code = end_within(EXIT_TIMEOUT, process.exit_code, process.tree)
    if code is not None:
        return _cause(code, sandboxed)
    if process.tree.is_alive():
        return ProcessEnded("it closed the channel of its results", outside=False)
    return ProcessEnded("the process that started it does not say how it ended", outside=True)


def _cause(exit_code: int, sandboxed: bool) -> ProcessEnded:
    """How a process ended."""
    if exit_code == LOST:
        return ProcessEnded("the process was lost with the one that started it", outside=True)
    words, name = end_of(exit_code, sandboxed)
    return ProcessEnded(f"the {words}", name in FOREIGN_SIGNALS)
