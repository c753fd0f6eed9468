"""Short cases for hostile controllers, run as an evaluation runs them."""

import functools
import shutil
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.case import Case
from orchestrator.benchmark.cases import cases
from orchestrator.execution import pool, store
from orchestrator.execution.job import Job
from orchestrator.fmi.archive import open_archive
from orchestrator.pairing.pairing import FULL_LENGTH, Pairing
from orchestrator.pairing.runs import CaseRun
from orchestrator.study import batch
from orchestrator.study.requests import STRIKES, Batch, BatchEntry
from plant_fmu.flexible_manipulator.parameters import NOMINAL

from .commands import ROOT

PROTOCOL = protocols.load("paper")

STRUCK, SPARED = Fraction("0.05"), Fraction("0.5")
"""Durations [s] of the case that a fault strikes and of the one after it."""


HANG_LIMIT = 1.2
"""Processor time [s] for a case that hangs; all others have plenty."""

PLENTY = 60.0
"""Processor time [s] for a struck case that does not hang."""


@functools.cache
def noise_cases() -> tuple[Case, ...]:
    """All noise cases of the protocol."""
    return tuple(case for case in cases(PROTOCOL, NOMINAL, 0) if case.test.name == "noise")


def short_cases(durations: Sequence[Fraction]) -> list[Case]:
    """Noise cases, cut to ``durations`` [s]."""
    return [
        replace(case, scenario=replace(case.scenario, duration=duration, stop_time=duration))
        for case, duration in zip(noise_cases(), durations, strict=False)
    ]


def bench(plant: Path, controller: Path, limit: float = PLENTY, **changes: Any) -> Pairing:
    """The plant with a controller; a struck case may take ``limit`` seconds, longer ones more in proportion."""
    opened = Pairing(open_archive(plant), open_archive(controller), timeout=limit * FULL_LENGTH / float(STRUCK))
    return replace(opened, **changes)


def run(bench: Pairing, chosen: Sequence[Case], workers: int = 1, keep_going: bool = True) -> list[CaseRun]:
    """The runs in the order of the cases ``chosen``."""
    return answered(bench, chosen, functools.partial(pool.run, workers=workers), keep_going)


def answered(
    bench: Pairing,
    chosen: Sequence[Case],
    execute: batch.Execute,
    keep_going: bool = False,
    first_sample_failure: CaseRun | None = None,
    known: store.Store | None = None,
) -> list[CaseRun]:
    """The runs of the cases ``chosen``, in their order, if ``execute`` runs the jobs."""
    entry = BatchEntry(
        PROTOCOL, bench, tuple(chosen), None if keep_going else STRIKES, first_sample_failure=first_sample_failure
    )
    with store.opened(None) if known is None else nullcontext(known) as results:
        return batch.run(Batch((entry,)), execute, results)[0]


def job(bench: Pairing, function: str, *tasks: bytes, limit: float = 60.0) -> Job:
    """A job of ``function`` in :mod:`hostile.works`, whose values are not decoded."""
    return Job(
        bench.plant,
        bench.controller,
        f"hostile.works:{function}",
        tasks,
        (limit,) * len(tasks),
        lambda _, value: value,
        limits=bench.limits,
        sandbox=bench.sandbox,
    )


def copied_packages(folder: Path) -> Path:
    """A copy of the project's packages in ``folder``."""
    for package in ("orchestrator", "controller_fmu", "plant_fmu"):
        shutil.copytree(ROOT / package, folder / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "build_fmus.py", folder)
    return folder
