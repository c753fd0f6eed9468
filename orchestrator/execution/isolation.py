"""Tasks in child processes that may crash, hang, leak or flood: each costs itself only."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from multiprocessing import connection

from ..cosim.slaves.log import printable
from .job import Died, Failed, Finished, Job, Outcome
from .launch import Child, Stopped, started
from .messages import Garbage, Inbox

TAIL = 8192
"""Bytes of a child's printed output that are kept."""

LINES = 10
LOOK = 0.2
"""Seconds between two looks at the stop signal and the child's memory."""

GRACE = 5.0
"""Seconds after which a child is ended that outlives its own alarm: an FMU may ignore that."""

SANDBOX_GRACE = 60.0
"""The same where the child starts from nothing and may have to compile."""

LAST_WORDS = 2.0
"""Seconds for a child whose pipe is closed to end."""

FOREIGN_SIGNALS = ("SIGKILL", "SIGTERM", "SIGHUP", "SIGQUIT")
LOST = 255
"""Exit code of a child whose fork server is gone."""


def run_isolated(job: Job, stop: threading.Event | None = None) -> Iterator[Outcome]:
    """Run the tasks of ``job`` in child processes and yield one outcome a task, in order.

    A task that fails or ends its process costs that task only: the rest goes on in a new child. One that fails in a
    process that has run others before, or whose process may have been ended by somebody else, gets a second chance in
    a new process: so the outcome does not depend on what ran before. Once ``stop`` is set, the running child is killed
    and nothing more is yielded.
    """
    stop = stop or threading.Event()
    first, tried = 0, -1
    while first < len(job.tasks) and not stop.is_set():
        rest = replace(job, tasks=job.tasks[first:], time_limits=job.time_limits[first:])
        with suppress(Stopped), started(rest, stop) as child:
            start = first
            for outcome in _listen(child, rest, stop):
                number = start + outcome.index
                if number != tried and _deserves_another_chance(outcome):
                    tried = number
                    break
                first = number + 1
                yield replace(outcome, index=number)


def _deserves_another_chance(outcome: Outcome) -> bool:
    if isinstance(outcome, Finished):
        return False
    if isinstance(outcome, Died):
        if outcome.outside:
            return True
        if outcome.timeout and outcome.place.sample > 0:
            return False  # what ran before may keep an FMU from starting; a hang on the way costs a whole time limit
    return outcome.index > 0


def _listen(child: Child, job: Job, stop: threading.Event) -> Iterator[Outcome]:
    """Outcomes of one child: until its tasks are done, one fails, or the process dies or has to."""
    index, begin, tail, printed = 0, time.perf_counter(), b"", 0
    looked = begin
    inbox = Inbox(child.outcomes.fileno())
    sources = [child.outcomes, child.output]
    grace = SANDBOX_GRACE if job.sandbox else GRACE

    def died(message: str, timeout: bool = False, outside: bool = False, kind: str = "") -> Died:
        child.process.kill()
        words, taken = _lines(tail + _rest(child)), time.perf_counter() - begin
        return Died(index, timeout, message, kind or message, taken, child.trace.read(), words, outside)

    while not stop.is_set():
        ready = connection.wait(sources, timeout=LOOK)
        if child.output in ready:
            piece = os.read(child.output.fileno(), 65536)
            tail, printed = (tail + piece)[-TAIL:], printed + len(piece)
            if not piece:
                sources.remove(child.output)
            if printed > job.limits.output:
                message = f"it printed or logged more than {job.limits.output / 1e6:.0f} MB"
                yield died(message, kind="it printed or logged too much")
                return
        if child.outcomes in ready:
            closed = not inbox.receive()
            try:
                for message in inbox.messages():
                    if not isinstance(message, Finished | Failed) or message.index != index:
                        raise Garbage("an outcome that is not due")
                    yield message
                    if isinstance(message, Failed):
                        return
                    index, begin, printed = index + 1, time.perf_counter(), 0
                    if index == len(job.tasks):
                        return
            except Garbage as problem:
                message = "it wrote into a pipe that is not its own"
                yield died(f"{message} ({problem})", kind=message)
                return
            if closed:
                yield died(*_cause(child.process.exit_code(LAST_WORDS), job.sandbox))
                return
        now = time.perf_counter()
        if now - looked > LOOK:
            looked = now
            used = child.process.family.memory()
            if used > job.limits.memory:
                message = f"it used {used / 1e6:.0f} MB of memory; the limit is {job.limits.memory / 1e6:.0f} MB"
                yield died(message, kind="it used too much memory")
                return
            if now - begin > job.time_limits[index] + grace:
                yield died(TIMED_OUT, timeout=True)
                return
            if child.outcomes not in ready and child.process.exit_code(0.0) is not None:
                # Whatever it has started may still hold the pipe open.
                yield died(*_cause(child.process.exit_code(0.0), job.sandbox))
                return


def _rest(child: Child) -> bytes:
    """What a dead child had printed last."""
    data = b""
    while child.output.poll() and (piece := os.read(child.output.fileno(), 65536)):
        data = (data + piece)[-TAIL:]
    return data


def _lines(tail: bytes) -> tuple[str, ...]:
    return tuple(line[:500] for line in printable(tail).splitlines()[-LINES:])


TIMED_OUT = "the time limit was reached"


def _cause(exit_code: int | None, sandboxed: bool) -> tuple[str, bool, bool]:
    """How a process ended, in words; whether at its time limit; whether somebody else may have ended it."""
    if exit_code is None:
        return "it closed the pipe of its results", False, False
    number = -exit_code
    if sandboxed and exit_code > 128:  # a sandbox passes signals on as exit codes
        number = exit_code - 128
    if number <= 0:
        return f"the process ended by itself with exit code {exit_code}", False, exit_code == LOST
    name = _name(number)
    if name == "SIGALRM":
        return TIMED_OUT, True, False
    return f"the process was ended by {name}", False, name in FOREIGN_SIGNALS


def _name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
