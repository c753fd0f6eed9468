"""A study without its simulations: what it would run, what is there already, and how long the rest would take."""

from __future__ import annotations

import time
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import Any

from ..benchmark.case import Case
from ..benchmark.metrics import case_result, expected
from ..benchmark.protocol import Protocol
from ..benchmark.results import Judgement, Measurements
from ..codec import Struct
from ..execution import store
from ..loop.trajectory import Status
from ..pairing.pairing import Pairing
from ..pairing.runs import CaseRun
from . import batch, rehearsal, stored
from .batch import Execute
from .requests import Batch, BatchEntry, Instant, Now, Record, Rehearse, Request, Requests, answered

MAX_SIMULATIONS = 100_000
"""Simulations after which a study is not played any further."""


class DryRun(Struct):
    """What a study would do: ``cases`` in all, those that are ``stored`` from an earlier run, and the processor time of
    one of the others [s], by their simulated time: how long a simulated second takes is measured by one case, or read
    from the store. What is recorded for a report counts, too, and start and end, each of which takes as long as this.
    ``seconds`` is the time that all take on ``workers`` processes.

    A study that decides by its results is played with results on target: then these are typical numbers.
    """

    cases: int
    stored: int
    seconds_per_case: float
    seconds: float
    workers: int


def plan(study: Requests[Any], execute: Execute, workers: int, folder: Path | None) -> DryRun:
    """What ``study`` would do with what is stored in ``folder``; the first sample of one case is simulated, which
    refuses what the study would refuse, and the longest of the first cases to measure the time.

    A case that is asked for again counts once, as it is in the store by then.
    """
    begin = time.perf_counter()
    cases, first, asked, rehearsed = 0, list[BatchEntry](), set[str](), list[Pairing]()
    taken, done, left = list[float](), 0.0, 0.0  # what is stored took, and simulated; and what is left simulates [s]
    with ExitStack() as stack:
        earlier = stack.enter_context(store.opened(folder)) if folder and (folder / store.FILE).is_file() else None

        def answer(request: Request) -> Any:
            nonlocal left
            match request:
                case Batch(entries):
                    first.extend(entries[: not first])
                    keys = [stored.keys(entry.protocol, entry.cases, entry.pairing) for entry in entries]
                    runs = [run_all(*pair) for pair in zip(entries, keys, strict=True)]
                    asked.update(*keys)
                    return runs
                case Rehearse(pairing, case):
                    if not rehearsed:  # once, so that input which the study would refuse is refused here
                        rehearsal.rehearse(case, pairing, probe=False, compare=False)
                        rehearsed.append(pairing)
                    return rehearsal.Rehearsal()
                case Record(_, shown):
                    left += sum(to_show.case.end for to_show in shown)
                    return ()
                case Now():
                    return Instant("", 0.0, workers)
            return None

        def run_all(entry: BatchEntry, keys: Sequence[str]) -> list[CaseRun]:
            nonlocal cases, done, left
            rest = entry.protocol, entry.cases, entry.pairing, entry.patience is not None
            there = {} if earlier is None or entry.force else stored.load(earlier, keys, *rest)
            new = [number for number, key in enumerate(keys) if key not in asked]
            cases += len(new)
            taken.extend(there[number].wall_time for number in new if number in there)
            done += sum(entry.cases[number].end for number in new if number in there)
            left += sum(entry.cases[number].end for number in new if number not in there)
            # A search that never fails on made-up results would go on for ever.
            if cases > MAX_SIMULATIONS:
                raise _Enough
            return [there.get(number) or on_target(entry.protocol, case) for number, case in enumerate(entry.cases)]

        with suppress(_Enough):
            answered(study, answer)
    per_second = sum(taken) / done if taken else _seconds(first[0], execute) if first else 0.0
    number = cases - len(taken)
    around = 2.0 * workers * (time.perf_counter() - begin)
    seconds_per_case = (per_second * left + around) / number if number else 0.0
    return DryRun(cases, len(taken), seconds_per_case, seconds_per_case * number / workers, workers)


class _Enough(Exception):
    """A study is not played any further."""


def _seconds(entry: BatchEntry, execute: Execute) -> float:
    """The time that a simulated second of the longest case of an entry takes [s]; with the start of its process if it
    comes to nothing."""
    longest, begin = max(entry.cases, key=lambda case: case.end), time.perf_counter()
    with store.opened(None) as empty:
        one = Batch((BatchEntry(entry.protocol, entry.pairing, (longest,)),))
        ((run,),) = batch.run(one, execute, empty)
    return (run.wall_time or time.perf_counter() - begin) / longest.end


def on_target(protocol: Protocol, case: Case, status: Status = Status.DONE, share: float = 1.0) -> CaseRun:
    """A made-up run of ``case`` that comes to rest, its criteria a ``share`` of their targets."""
    names = expected(protocol, case) if status is Status.DONE else ()
    targets = {name: share * spec.target for name, spec in protocol.criteria.items()}
    figures: dict[str, Any] = {name: True if name == "settled" else targets.get(name, 0.0) for name in names}
    judgement = Judgement(status=status, time=float(case.scenario.duration), measurements=Measurements(**figures))
    return CaseRun(case, case_result(case, judgement))
