"""Groups of tasks over child processes. The parent never loads an FMU's binary."""

from __future__ import annotations

import multiprocessing
import os
import queue
import signal
import threading
import time
from collections.abc import Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from multiprocessing import connection
from multiprocessing.process import BaseProcess
from typing import Any

from . import child
from .job import Died, Job, Outcome

TAIL = 4096
"""Bytes of a child's printed output that are kept."""


def _context() -> Any:
    """Children come from a fork server that has the stack loaded already; where there is none, they are spawned."""
    if "forkserver" in multiprocessing.get_all_start_methods():
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(["orchestrator.execution.preload"])
        return context
    return multiprocessing.get_context("spawn")


def run_isolated(job: Job, stop: threading.Event | None = None) -> Iterator[Outcome]:
    """Run the tasks of ``job`` in child processes and yield one outcome a task, in order.

    A task that fails or ends its process costs that task only: the rest goes on in a fresh child. Once ``stop`` is
    set, the running child is killed and nothing more is yielded.
    """
    first = 0
    while first < len(job.tasks):
        rest = replace(job, tasks=job.tasks[first:], time_limits=job.time_limits[first:])
        done = 0
        for outcome in _run_child(rest, stop or threading.Event()):
            yield replace(outcome, index=first + outcome.index)
            done = outcome.index + 1
        if done == 0:
            return
        first += done


def run(jobs: Sequence[Job], workers: int) -> Iterator[tuple[int, Outcome]]:
    """Run ``jobs`` on ``workers`` processes at a time; yields (number of the job, outcome) as they come.

    Closing the iterator, or an exception where it is consumed, ends all children.
    """
    results: queue.Queue[tuple[int, Outcome] | BaseException | None] = queue.Queue()
    stop = threading.Event()

    def drive(number: int) -> None:
        try:
            for outcome in run_isolated(jobs[number], stop):
                results.put((number, outcome))
        except BaseException as problem:  # must reach the consumer, not die with this thread
            results.put(problem)
        results.put(None)

    with ThreadPoolExecutor(workers) as threads:
        try:
            for number in range(len(jobs)):
                threads.submit(drive, number)
            pending = len(jobs)
            while pending:
                item = results.get()
                if isinstance(item, BaseException):
                    raise item
                if item is None:
                    pending -= 1
                else:
                    yield item
        finally:
            stop.set()
            threads.shutdown(wait=True, cancel_futures=True)


def _run_child(job: Job, stop: threading.Event) -> Iterator[Outcome]:
    """Outcomes of one child process: until its tasks are done, one fails, or the process dies."""
    context = _context()
    outcomes, outcomes_end = context.Pipe(duplex=False)
    output, output_end = context.Pipe(duplex=False)
    process = context.Process(target=child.main, args=(job, outcomes_end, output_end), daemon=True)
    begin = time.perf_counter()
    try:
        process.start()
        outcomes_end.close()
        output_end.close()
        yield from _listen(process, outcomes, output, stop, begin)
    finally:
        _end(process)
        outcomes.close()
        output.close()


def _listen(
    process: BaseProcess,
    outcomes: connection.Connection,
    output: connection.Connection,
    stop: threading.Event,
    begin: float,
) -> Iterator[Outcome]:
    tail = b""
    index = 0
    sources: list[Any] = [outcomes, output.fileno()]
    while not stop.is_set():
        ready = connection.wait(sources, timeout=0.2)
        if output.fileno() in ready:
            printed = os.read(output.fileno(), 65536)
            tail = (tail + printed)[-TAIL:]
            if not printed:
                sources.remove(output.fileno())
        if outcomes not in ready:
            continue
        try:
            message = outcomes.recv()
        except (EOFError, ConnectionResetError):
            process.join()
            lines = tuple(tail.decode(errors="replace").splitlines()[-5:])
            yield Died(index, *_cause(process.exitcode), time.perf_counter() - begin, lines)
            return
        if message == child.GOODBYE:
            return
        yield message
        index = message.index + 1
        begin = time.perf_counter()


def _cause(exit_code: int | None) -> tuple[bool, str]:
    """Whether a process ended at its time limit, and how it ended, in words."""
    if exit_code is not None and exit_code < 0:
        name = signal.Signals(-exit_code).name
        if os.name == "posix" and -exit_code == signal.SIGALRM:
            return True, "the time limit was reached"
        return False, f"the process was ended by {name}"
    return False, f"the process ended by itself with exit code {exit_code}"


def _end(process: BaseProcess) -> None:
    """Make sure that the child and whatever it started are gone."""
    if process.pid is None:
        return
    if os.name == "posix":
        try:
            os.killpg(process.pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            process.kill()
    else:
        process.kill()
    process.join()
