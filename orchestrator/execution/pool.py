"""Jobs over local worker processes, several at a time."""

from __future__ import annotations

import os
import queue
import threading
from collections.abc import Generator, Sequence
from dataclasses import replace

from .job import Job, Outcome
from .supervision import run_isolated


def run(jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Outcome], None, None]:
    """Run ``jobs`` on ``workers`` processes at a time; yields (number of the job, outcome) as they come.

    An isolated controller shares the processor of its worker: the two take turns, and waking a processor that sleeps
    takes ten times as long as changing from one process to the other.

    This process never loads an FMU's binary. Closing the generator, or an exception where it is consumed, ends all
    workers.
    """
    waiting: queue.SimpleQueue[int] = queue.SimpleQueue()
    results: queue.SimpleQueue[tuple[int, Outcome] | BaseException | None] = queue.SimpleQueue()
    stop = threading.Event()

    # Those that this process may use, not those of the machine: containers and batch systems give a part.
    cores = sorted(os.sched_getaffinity(0)) if hasattr(os, "sched_setaffinity") else [-1]

    def drive(place: int) -> None:
        core = cores[place % len(cores)]
        try:
            while not stop.is_set():
                number = waiting.get_nowait()
                job = replace(jobs[number], core=core) if jobs[number].isolated else jobs[number]
                for outcome in run_isolated(job, stop):
                    results.put((number, outcome))
        except queue.Empty:
            pass
        except BaseException as problem:  # must reach the consumer, not die with this thread
            results.put(problem)
        results.put(None)

    for number in range(len(jobs)):
        waiting.put(number)
    # Not an executor's threads: those take no work once the main thread has ended, though another may be evaluating;
    # and daemons, so that a program whose main thread has ended does not wait for them.
    threads = [threading.Thread(target=drive, args=(place,), daemon=True) for place in range(min(workers, len(jobs)))]
    try:
        for thread in threads:
            thread.start()
        pending = len(threads)
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
        for thread in threads:
            if thread.is_alive():
                thread.join()
