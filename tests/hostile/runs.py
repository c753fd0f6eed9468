"""Short cases for hostile controllers, run as an evaluation runs them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.case import Case
from orchestrator.benchmark.metrics import CaseResult
from orchestrator.commands import nominal_parameters
from orchestrator.cosim.archive import Archive, open_archive
from orchestrator.execution import evaluation, pool
from orchestrator.execution.evaluation import Bench

PROTOCOL = protocols.load("quick")

STRUCK, SPARED = 0.05, 0.06
"""Durations [s] of the case that a fault strikes and of the one after it."""


def short_cases(plant: Archive, durations: Sequence[float]) -> list[Case]:
    """Noise cases of the quick protocol, cut to ``durations`` [s]; no two are alike."""
    nominal = nominal_parameters(plant, {})
    noisy = [case for case in protocols.cases(PROTOCOL, nominal, 0) if case.test.name == "noise"]
    return [
        replace(case, scenario=replace(case.scenario, duration=Fraction(str(duration)) + Fraction(i // 4, 4000)))
        for i, duration in enumerate(durations)
        for case in [noisy[i % 4]]
    ]


def bench(plant: Path, controller: Path, **changes: object) -> Bench:
    """The plant with the controller in ``controller``."""
    return replace(Bench(open_archive(plant), open_archive(controller), timeout=10.0), **changes)


def run(bench: Bench, cases: Sequence[Case], workers: int = 1, keep_going: bool = True) -> list[CaseResult]:
    """The results in the order of ``cases``."""
    execute = functools.partial(pool.run, workers=workers)
    found = {result.case: result for result in evaluation.evaluate(PROTOCOL, cases, bench, execute, (), keep_going)}
    return [found[case] for case in cases]
