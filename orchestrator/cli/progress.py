"""Progress of an evaluation on standard error: cases done, running cost, time left."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, rules
from ..benchmark.scorecard import score
from ..study.requests import OnResult
from ..views.terminal import terminal

ESTIMATE_EVERY = 8
"""Cases between two estimates of the cost; an estimate takes some milliseconds."""


@contextmanager
def progress(protocol: Protocol | None = None) -> Iterator[OnResult]:
    """A live progress bar; yields a function to call with each result. With a protocol, it shows V so far."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("cases  V so far {task.fields[cost]}" if protocol is not None else "cases"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    results: list[CaseResult] = []
    bar = Progress(*columns, console=terminal(stderr=True))
    task = bar.add_task("evaluating", total=None, cost="-")
    with ExitStack() as stack:

        def update(result: CaseResult, done: int, total: int) -> None:
            if not bar.live.is_started:  # what is wrong with the input is said before any bar is drawn
                stack.enter_context(bar)
            if done == 1:  # of the first seed, or of the next
                results.clear()
            results.append(result)
            bar.update(task, completed=done, total=total)
            if protocol is not None and (done % ESTIMATE_EVERY == 0 or done == total):
                cost = estimate(protocol, results)
                bar.update(task, cost="-" if cost is None else f"{cost:.1f}")

        yield update


def estimate(protocol: Protocol, results: Sequence[CaseResult]) -> float | None:
    """The mean of V_k over the configurations whose performance tests are all done; None before the first."""
    tests = {test.name: len(protocol.sets[test.systems]) for test in protocol.tests if test.criteria}
    counts: dict[int, int] = {}
    for result in results:
        if result.test in tests:
            counts[result.configuration.index] = counts.get(result.configuration.index, 0) + 1
    # V is a mean over configurations of the worst case: of one that is not complete, it would only grow.
    ready = [result for result in results if counts.get(result.configuration.index) == sum(tests.values())]
    return score(rules(protocol), ready).cost if ready else None
