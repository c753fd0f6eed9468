"""Short cases for hostile controllers, run as an evaluation runs them."""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.case import Case
from orchestrator.benchmark.metrics import CaseResult
from orchestrator.commands import nominal_parameters
from orchestrator.cosim.archive import Archive, open_archive
from orchestrator.execution import evaluation, pool
from orchestrator.execution.evaluation import FULL_LENGTH, Bench

PROTOCOL = protocols.load("quick")

STRUCK, SPARED = Fraction("0.05"), Fraction("0.5")
"""Durations [s] of the case that a fault strikes and of the one after it."""


def short_cases(plant: Archive, durations: Sequence[Fraction]) -> list[Case]:
    """Noise cases of the quick protocol, cut to ``durations`` [s]."""
    noisy = [case for case in protocols.cases(PROTOCOL, nominal_parameters(plant, {}), 0) if case.test.name == "noise"]
    return [
        replace(case, scenario=replace(case.scenario, duration=duration))
        for i, duration in enumerate(durations)
        for case in [noisy[i % len(noisy)]]
    ]


def bench(plant: Path, controller: Path, limit: float = 10.0, **changes: Any) -> Bench:
    """The plant with a controller; a struck case may take ``limit`` seconds, longer ones more in proportion."""
    opened = Bench(open_archive(plant), open_archive(controller), timeout=limit * FULL_LENGTH / float(STRUCK))
    return replace(opened, **changes)


def run(bench: Bench, cases: Sequence[Case], workers: int = 1, keep_going: bool = True) -> list[CaseResult]:
    """The results in the order of ``cases``."""
    execute = functools.partial(pool.run, workers=workers)
    found = {result.case: result for result in evaluation.evaluate(PROTOCOL, cases, bench, execute, (), keep_going)}
    return [found[case] for case in cases]
