"""A run: the results of an evaluation and its recordings, on disk and back."""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import asdict, replace

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.results import SCHEMA, SCHEMA_2, Results
from ..benchmark.scorecard import score
from ..codec import Malformed, from_json, to_json
from ..errors import InputError
from ..loop.trajectory import Status
from . import recording
from .documents import file_of, read, rules_problem
from .files import CASES, FIGURES, MAT, PARQUET, REPORT, RESULTS, TRAJECTORIES, prepare_folder, remove, write_text
from .recording import SPREAD, Recording
from .tables import csv_text

SINGLE = 1e-5
"""Relative error that the single precision of recordings may make."""


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Run:
    """``results`` and ``recordings``, which may be empty; ``folder`` is where they are stored, if they are."""

    results: Results
    recordings: tuple[Recording, ...] = ()
    folder: Path | None = None

    def recorded(self, role: str) -> list[Recording]:
        """The recordings with this role, such as ``B5``, ``A2 2`` or ``spread``."""
        return [entry for entry in self.recordings if role in entry.about.roles]


def contradictions(run: Run) -> list[str]:
    """Recordings that do not show what the results say of their case, in words.

    Both come from the same simulation, done twice: a difference is a fault, or somebody's work.
    """
    cases = {case.id: case for case in run.results.cases}
    found = []
    for entry in run.recordings:
        case = cases.get(entry.about.id)
        if case is None or case.status is not Status.DONE or SPREAD in entry.about.roles:
            continue
        torques = np.max(np.abs(entry.torque[:, 1:]), axis=0, initial=0.0)
        shown = {"B3": float(torques[0]), "B4": float(torques[1])}
        shown["B5"] = float(np.max(entry.error[entry.motion[:, 0] >= entry.about.window[0]], initial=0.0))
        for name, value in shown.items():
            told = getattr(case.measurements, name)
            if told is not None and not math.isclose(value, told, rel_tol=SINGLE):
                found.append(f"{case.id}: {name} is {told:.6g} in the results, {value:.6g} in the recording")
    return found


def save_run(results: Results, recordings: Sequence[Recording], folder: Path) -> None:
    """Write ``cases.csv``, ``trajectories.npz`` and ``results.json`` into ``folder``, each in one go, the summary last.

    What was made of other results that are there is removed first: what is kept belongs to ``results``, whenever the
    process is interrupted.
    """
    prepare_folder(folder)
    if _is_outdated(folder, results):
        logger.warning("other results in %s are replaced", folder, extra={"what": "replaced"})
        for name in (RESULTS, CASES, TRAJECTORIES, REPORT, PARQUET, MAT, FIGURES):
            remove(folder / name)
    if recordings:
        recording.save(recordings, folder)
    write_text(folder / CASES, csv_text(results))
    write_text(folder / RESULTS, to_json(results) + "\n")


def _is_outdated(folder: Path, results: Results) -> bool:
    """Whether ``folder`` holds other results."""
    try:
        there = from_json((folder / RESULTS).read_bytes(), Results)
    except FileNotFoundError:
        return False
    except (OSError, Malformed):
        return True
    return replace(there, timing=results.timing, environment=results.environment) != results


def load_run(path: Path) -> Run:
    """The run in the folder ``path`` (or of that results file).

    The scorecard is computed again from the cases; a file of the older form gets that one. Raises :class:`InputError`
    if there is none, or a field is not what it should be, or the scorecard is not that of the cases.
    """
    file = file_of(path, RESULTS)
    results = read(file, Results, SCHEMA, older=SCHEMA_2)
    if results.schema == SCHEMA_2:
        results = replace(results, schema=SCHEMA, **asdict(score(results.rules, results.cases)))
    check_consistent(results, file)
    return Run(results, recording.load(file.parent), file.parent)


def check_consistent(results: Results, file: Path) -> None:
    """Raise :class:`InputError` if the parts of ``results`` contradict each other."""
    if problem := rules_problem(results.rules) or _problem(results):
        raise InputError(f"{file} contradicts itself: {problem}.", "damaged", file)


def _problem(results: Results) -> str:
    tests = {test.name for test in results.rules.tests}
    names = [case.id for case in results.cases]
    if not results.cases or len(set(names)) < len(names) or not {case.test for case in results.cases} <= tests:
        return "its cases are not those of its rules"
    if not set(NOMINAL) <= set(results.plant.nominal):
        return "parameters of the plant are missing"
    return "" if score(results.rules, results.cases) == results.scorecard else "its scorecard is not that of its cases"
