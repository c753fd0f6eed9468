"""Tasks in worker processes. A task that crashes, hangs, or uses too much memory or output affects no other task."""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import suppress

from msgspec.structs import replace

from ..codec import Malformed
from ..errors import EnvironmentFault
from ..fmi.archive import restore
from ..fmi.trace import CONTROLLER
from ..text import printable
from .job import MANY_LOGGED, Died, Done, Job, Outcome
from .launch import EXIT_TIMEOUT, LOST, Child, Process, Stopped, started
from .messages import Failed, Finished, Garbage, Inbox, Loaded, error_of, readable
from .process_tree import FOREIGN_SIGNALS, end_of
from .standstill import Lookout
from .time_limit import Stopwatch, end_within

NOT_BY_CONTROLLER = "outside"
"""Code of a fault for which an isolated controller is not to blame: but it has seen its draws, so they are spent."""

TAIL_BYTES = 8192
"""Bytes of a worker's printed output that are kept."""

MAX_LINES = 10
"""Lines that are shown of what a dead worker had printed, and of what the FMUs had logged there."""

POLL_INTERVAL = 0.2
"""Seconds between two looks at the stop signal and at what the worker uses."""

START_TIMEOUT, FRESH_START_TIMEOUT = 10.0, 60.0
"""Seconds that a worker may take to load the FMUs, on top of its first task's limit: a forked one, and one that starts
from nothing and may have to compile."""

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
    index, tail, printed, loaded = 0, b"", 0, False
    watch, lookout = Stopwatch(child.process.tree), Lookout()
    inbox = Inbox(child.channel, job.largest)
    sources = [child.channel, child.output]
    start = FRESH_START_TIMEOUT if job.sandbox and not job.isolated else START_TIMEOUT

    def died(message: str, timeout: bool = False, outside: bool = False, kind: str = "") -> Died:
        child.process.kill()
        count, logged = child.trace.logged()
        words = (*_lines(tail + _rest(child.output, job.limits.output)), *logged[-MAX_LINES:])
        place = child.trace.read()
        if timeout and count > MANY_LOGGED:
            message += f"; it had logged {count} messages, which takes time"
        if not loaded and place.side != CONTROLLER:
            told = "\n  ".join((f"A simulation's process ended before it had loaded the FMUs: {message}", *words))
            raise EnvironmentFault(told, "worker-lost")
        # Somebody has stopped the process (SIGSTOP, a debugger): the time that passed is not the controller's.
        outside |= timeout and watch.spent.stopped
        return Died(index, timeout, message, kind or message, watch.elapsed, place, words, outside)

    while not stop.is_set():
        ready = readable(sources, POLL_INTERVAL)
        if child.output in ready:
            piece = os.read(child.output, 65536)
            tail, printed = (tail + piece)[-TAIL_BYTES:], printed + len(piece)
            if not piece:
                sources.remove(child.output)
            if printed > job.limits.output:
                told = f"it printed or logged more than {job.limits.output / 1e6:.0f} MB"
                yield died(told, kind="it printed or logged too much")
                return
        if child.channel in ready:
            closed = not inbox.receive()
            try:
                for message in inbox.messages():
                    if isinstance(message, Loaded):
                        if loaded:
                            raise Garbage("it has loaded the FMUs twice")
                        loaded, lookout = True, Lookout()
                        watch.begin()
                        continue
                    # An FMU may write into the channel: a result before the FMUs
                    # are loaded, or of another task, is a forged one.
                    if message.index != index or (isinstance(message, Finished) and not loaded):
                        raise Garbage("an outcome that is not due")
                    if isinstance(message, Failed):
                        if message.error.kind == "environment":
                            raise error_of(message.error)
                        if message.error.kind == "crash":  # of the process of an isolated controller
                            yield died(message.error.message, outside=message.error.what == "killed")
                        else:
                            yield message
                        return
                    yield Done(index, job.decode(index, message.value), message.wall_time, child.trace.logged()[0])
                    index, printed = index + 1, 0
                    watch.begin()
                    if index == len(job.tasks):
                        return
            except (Garbage, Malformed) as problem:
                words = "it wrote into a channel that is not its own"
                yield died(f"{words} ({problem})", kind=words)
                return
            if closed:
                words, outside = _ending(child.process, job.sandbox)
                yield died(words, outside=outside)
                return
        if watch.age > POLL_INTERVAL:
            used = watch.look()
            if used.memory > job.limits.memory:
                told = f"it used {used.memory / 1e6:.0f} MB of memory; the limit is {job.limits.memory / 1e6:.0f} MB"
                yield died(told, kind="it used too much memory")
                return
            if used.processes > job.limits.processes:
                yield died(f"it started more than {job.limits.processes} processes")
                return
            limit, longest = job.time_limits[index], job.longest_call
            if not loaded:
                limit, longest = limit + start, math.inf
            now = time.monotonic()
            lookout = lookout.after(index, child.trace.read(), now, watch.spent)
            told, kind = watch.spent.excess(limit)
            if not told:
                told, kind = lookout.here(watch.spent).excess(longest)
            if told:
                yield died(told, timeout=True, kind=kind)
                return
            # What is in the channel goes first: a worker may end right after its last result.
            code = None if child.channel in ready else child.process.exit_code(0.0)
            if code is not None:  # whatever it has started may still hold the channel open
                words, outside = _cause(code, job.sandbox)
                yield died(words, outside=outside)
                return
            standstill = lookout.standstill(now, watch.spent, limit, longest)
            if standstill is not None:
                job.on_standstill(index, standstill)
                lookout = lookout.silent()


def _rest(output: int, most: int) -> bytes:
    """What a dead worker had printed last, of at most ``most`` bytes: what it has started may go on printing."""
    data, count = b"", 0
    while count < most and readable([output], 0.0) and (piece := os.read(output, 65536)):
        data, count = (data + piece)[-TAIL_BYTES:], count + len(piece)
    return data


def _lines(tail: bytes) -> tuple[str, ...]:
    return tuple(line[:500] for line in printable(tail).splitlines()[-MAX_LINES:])


def _ending(process: Process, sandboxed: bool) -> tuple[str, bool]:
    """How a process ends that has closed its channel, in words; whether somebody else may have ended it."""
    code = end_within(EXIT_TIMEOUT, process.exit_code, process.tree)
    if code is not None:
        return _cause(code, sandboxed)
    if process.tree.is_alive():
        return "it closed the channel of its results", False
    return "the process that started it does not say how it ended", True


def _cause(exit_code: int, sandboxed: bool) -> tuple[str, bool]:
    """How a process ended, in words; whether somebody else may have ended it."""
    if exit_code == LOST:
        return "the process was lost with the one that started it", True
    words, name = end_of(exit_code, sandboxed)
    return f"the {words}", name in FOREIGN_SIGNALS
