"""Jobs over local child processes, several at a time."""

from __future__ import annotations

import queue
import threading
from collections.abc import Generator, Sequence
from concurrent.futures import ThreadPoolExecutor

from .isolation import run_isolated
from .job import Job, Outcome


def run(jobs: Sequence[Job], workers: int) -> Generator[tuple[int, Outcome], None, None]:
    """Run ``jobs`` on ``workers`` processes at a time; yields (number of the job, outcome) as they come.

    The parent never loads an FMU's binary. Closing the generator, or an exception where it is consumed, ends all
    children.
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
