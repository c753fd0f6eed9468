"""Tasks in child processes that may crash, hang, leak or flood: each costs itself only."""

from __future__ import annotations

import os
import signal
import threading
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import connection

import psutil

from .child import GOODBYE
from .job import Died, Job, Outcome
from .launch import Child, started

TAIL = 8192
"""Bytes of a child's printed output that are kept."""

LINES = 10
LOOK = 0.2
"""Seconds between two looks at the stop signal and the child's memory."""


def run_isolated(job: Job, stop: threading.Event | None = None) -> Iterator[Outcome]:
    """Run the tasks of ``job`` in child processes and yield one outcome a task, in order.

    A task that fails or ends its process costs that task only: the rest goes on in a new child. Once ``stop`` is set,
    the running child is killed and nothing more is yielded.
    """
    stop = stop or threading.Event()
    first = 0
    while first < len(job.tasks) and not stop.is_set():
        rest = replace(job, tasks=job.tasks[first:], time_limits=job.time_limits[first:])
        done = 0
        with started(rest) as child:
            for outcome in _listen(child, rest, stop):
                done = outcome.index + 1
                yield replace(outcome, index=first + outcome.index)
        if done == 0:
            return
        first += done


def _listen(child: Child, job: Job, stop: threading.Event) -> Iterator[Outcome]:
    """Outcomes of one child: until its tasks are done, one fails, or the process dies or has to."""
    index, begin, tail, printed = 0, time.perf_counter(), b"", 0
    looked = begin
    sources = [child.outcomes, child.output]
    verdict = ""
    while not stop.is_set():
        ready = connection.wait(sources, timeout=LOOK)
        if child.output in ready:
            piece = os.read(child.output.fileno(), 65536)
            tail, printed = (tail + piece)[-TAIL:], printed + len(piece)
            if not piece:
                sources.remove(child.output)
            if printed > job.limits.output:
                verdict = f"it printed or logged more than {job.limits.output / 1e6:.0f} MB"
        if time.perf_counter() - looked > LOOK:
            looked = time.perf_counter()
            used = _memory(child.process.pid)
            if used > job.limits.memory:
                verdict = f"it used {used / 1e9:.1f} GB of memory; the limit is {job.limits.memory / 1e9:.1f} GB"
        if verdict:
            child.process.kill()
            yield Died(index, False, verdict, time.perf_counter() - begin, child.trace.read(), _lines(tail))
            return
        if child.outcomes not in ready:
            continue
        try:
            message = child.outcomes.recv()
        except (EOFError, OSError):
            timeout, text = _cause(child.process.exit_code())
            tail += _rest(child)
            yield Died(index, timeout, text, time.perf_counter() - begin, child.trace.read(), _lines(tail))
            return
        if message == GOODBYE:
            return
        yield message
        index, begin, printed = message.index + 1, time.perf_counter(), 0


def _rest(child: Child) -> bytes:
    """What a dead child had printed last."""
    data = b""
    while child.output.poll() and (piece := os.read(child.output.fileno(), 65536)):
        data = (data + piece)[-TAIL:]
    return data


def _lines(tail: bytes) -> tuple[str, ...]:
    return tuple(line[:500] for line in tail.decode(errors="replace").splitlines()[-LINES:])


def _memory(pid: int) -> int:
    """Resident memory [bytes] of a process and its descendants."""
    try:
        process = psutil.Process(pid)
        return sum(one.memory_info().rss for one in (process, *process.children(recursive=True)))
    except psutil.Error:
        return 0


def _cause(exit_code: int | None) -> tuple[bool, str]:
    """Whether a process ended at its time limit, and how it ended, in words."""
    if exit_code is not None and (exit_code < 0 or exit_code > 128):
        number = -exit_code if exit_code < 0 else exit_code - 128  # a sandbox passes signals on as exit codes
        if os.name == "posix" and number == signal.SIGALRM:
            return True, "the time limit was reached"
        return False, f"the process was ended by {_name(number)}"
    return False, f"the process ended by itself with exit code {exit_code}"


def _name(number: int) -> str:
    try:
        return signal.Signals(number).name
    except ValueError:
        return f"signal {number}"
