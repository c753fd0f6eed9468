"""Cases of several controllers side by side: no core waits for the last case of one before it begins the next."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace

from ..benchmark.case import Case
from ..benchmark.metrics import named
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, Judgement
from ..execution.store import Store
from ..loop.trajectory import Status
from . import stored
from .campaign import Bench, CaseRun, Execute, case_run, judging


@dataclass(frozen=True)
class SideBySide:
    """What runs cases of several benches: ``execute`` here or on a cluster; ``known`` keeps what is finished."""

    protocol: Protocol
    execute: Execute
    known: Store

    def run(self, wanted: Sequence[tuple[Bench, Sequence[Case]]]) -> list[list[CaseResult]]:
        """The results of each bench's cases, in their order; those after one that has no verdict are skipped."""
        keys = [stored.keys(self.protocol, cases, bench) for bench, cases in wanted]
        runs: list[dict[int, CaseRun]] = [
            stored.load(self.known, own, self.protocol, cases, bench, True)
            for own, (bench, cases) in zip(keys, wanted, strict=True)
        ]
        waiting = [
            []
            if any(run.result.status not in stored.LASTING for run in found.values())
            else [number for number in range(len(cases)) if number not in found]
            for (_, cases), found in zip(wanted, runs, strict=True)
        ]
        places = [place for place, numbers in enumerate(waiting) if numbers]
        # One process each: whatever else a candidate does, it costs one failure.
        jobs = [
            replace(
                judging(self.protocol, [wanted[place][1][n] for n in waiting[place]], wanted[place][0]), give_up=True
            )
            for place in places
        ]
        with contextlib.closing(self.execute(jobs)) as outcomes:
            for job, outcome in outcomes:
                place = places[job]
                (bench, cases), number = wanted[place], waiting[place][outcome.index]
                runs[place][number] = run = case_run(cases[number], outcome)
                stored.keep(self.known, keys[place][number], run, bench)
        return [
            [found[number].result if number in found else _skipped(case) for number, case in enumerate(cases)]
            for found, (_, cases) in zip(runs, wanted, strict=True)
        ]


def _skipped(case: Case) -> CaseResult:
    return named(case, Judgement(status=Status.SKIPPED, time=0.0, message="skipped after a failure"))
