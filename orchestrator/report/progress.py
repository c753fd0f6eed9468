"""Progress of an evaluation on standard error: cases done, running cost, time left."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..benchmark.metrics import CaseResult
from ..benchmark.protocol import Protocol
from ..benchmark.scorecard import score
from .terminal import terminal

EVERY = 8
"""Cases between two estimates of the cost; an estimate takes some milliseconds."""


@contextmanager
def progress(protocol: Protocol, total: int) -> Iterator[Callable[[list[CaseResult]], None]]:
    """A live progress bar; the function it gives is to be called with all results there are."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("cases  V so far {task.fields[cost]}"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=terminal(stderr=True)) as bar:
        task = bar.add_task("evaluating", total=total, cost="-")

        def update(results: list[CaseResult]) -> None:
            bar.update(task, completed=len(results))
            if len(results) % EVERY == 0 or len(results) == total:
                cost = estimate(protocol, results)
                bar.update(task, cost="-" if cost is None else f"{cost:.1f}")

        yield update


def estimate(protocol: Protocol, results: list[CaseResult]) -> float | None:
    """The mean of V_k over the configurations whose performance tests are all done; None before the first."""
    wanted = sum(len(protocol.raw[test.systems]["systems"]) for test in protocol.tests if test.criteria)
    counts: dict[int, int] = {}
    for result in results:
        if result.case.test.criteria:
            index = result.case.configuration.index
            counts[index] = counts.get(index, 0) + 1
    ready = [result for result in results if counts.get(result.case.configuration.index) == wanted]
    return score(protocol, ready, len(ready)).cost if ready else None
