"""What the pages' scripts are given: plain values and packed arrays, and nothing that a script could run."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ..benchmark.results import CaseResult, CriterionSpec
from ..benchmark.scorecard import outcome
from ..benchmark.tally import tally
from ..codec import plain
from ..views.units import SHOWN
from .commands import recording_command
from .head import PlantRecord
from .recording import SYSTEMS, Recording, thin
from .results import Results
from .run import Run

SPREAD_INTERVALS = 1000
"""Intervals that the many trajectories of Figures 11 and 12 are thinned out to once more."""

ROWS = 90_000
"""Rows of all other recordings together, of motion and of torque each, that keep a page below 5 MB."""


def report_payload(run: Run) -> dict[str, Any]:
    """Everything the report's figures show."""
    return {
        **workspace(run.results),
        "criteria": criteria(run.results.criteria),
        "rules": plain(run.results.rules),
        "stability": _stability(run.results),
        "recordings": [packed(entry, recording_command(run.results.head, entry.about)) for entry in affordable(run)],
        "spread": [packed_error(entry, SPREAD_INTERVALS) for entry in run.recorded(SYSTEMS)],
    }


def workspace(results: Results) -> dict[str, Any]:
    """Poses with their costs, and the arm's link lengths [m]."""
    return {"configurations": plain(results.configurations), "links": links(results.plant)}


def links(plant: PlantRecord) -> list[float]:
    """Lengths of the arm's links [m]."""
    return [plant.nominal["l[1]"], plant.nominal["l[2]"]]


def criteria(entries: Mapping[str, CriterionSpec]) -> list[dict[str, Any]]:
    """B1..B7 with the factor and name of the unit they are shown in."""
    return [
        {"name": name, **plain(entry), "factor": SHOWN[entry.unit].factor, "shown": SHOWN[entry.unit].shown}
        for name, entry in entries.items()
    ]


def packed(entry: Recording, command: str) -> dict[str, Any]:
    """A whole recording with the ``command`` that repeats its case; columns are base64 of single-precision numbers."""
    return {
        **plain(entry.about),
        "command": command,
        "motion": [_packed(column) for column in entry.motion.T],
        "torque": [_packed(column) for column in entry.torque.T],
    }


def packed_error(entry: Recording, intervals: int) -> dict[str, Any]:
    """A recording's TCP error over time only, thinned out further: ``curve`` has the columns t [s] and error [m]."""
    kept = thin(entry.error[:, None], intervals)
    return {**plain(entry.about), "curve": [_packed(entry.motion[kept, 0]), _packed(entry.error[kept])]}


def packed_worst(entry: Recording, intervals: int, results: Results) -> dict[str, Any]:
    """Error and torques of a worst case, thinned out further, and the command that repeats it."""
    kept = thin(entry.torque[:, 1:], intervals)
    return {
        **packed_error(entry, intervals),
        "torque": [_packed(column) for column in entry.torque[kept].T],
        "command": recording_command(results.head, entry.about),
    }


def _packed(column: np.ndarray) -> str:
    return base64.b64encode(np.ascontiguousarray(column, dtype="<f4").tobytes()).decode("ascii")


def affordable(run: Run) -> list[Recording]:
    """The recordings but the spread; if they are too many or too lively for a page, thinned out further, by the same
    signals as in :func:`.recording.record`."""
    kept = [entry for entry in run.recordings if SYSTEMS not in entry.about.roles]
    tcp = [np.column_stack([entry.motion[:, 1:3], entry.error]) for entry in kept]
    motions = _thinned([entry.motion for entry in kept], tcp)
    torques = _thinned([entry.torque for entry in kept], [entry.torque[:, 1:] for entry in kept])
    thinned = zip(kept, motions, torques, strict=True)
    return [replace(entry, motion=motion, torque=torque) for entry, motion, torque in thinned]


def _thinned(tables: Sequence[np.ndarray], signals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """``tables`` with at most ``ROWS`` rows together, thinned out by ``signals``, each (N, signals), if need be."""
    if sum(map(len, tables)) <= ROWS:
        return list(tables)
    # An interval keeps two rows per signal, and a recording its first and last row.
    intervals = (ROWS // len(tables) - 2) // (2 * signals[0].shape[1])
    return [table[thin(values, intervals)] for table, values in zip(tables, signals, strict=True)]


def stability(results: Results) -> list[tuple[CaseResult, bool | None]]:
    """Every case with a requirement, and whether it passed (None: not judged)."""
    limits = results.rules.stability
    asked = (case for case in results.cases if results.rules.test(case.test).requirements)
    return [(case, tally([outcome(case, limits)], 1).passed) for case in asked]


def _stability(results: Results) -> list[dict[str, Any]]:
    """The same for the chart."""
    return [
        {
            "id": case.id,
            "configuration": case.configuration.index,
            "test": case.test,
            "limit_cycle": case.measurements.limit_cycle,
            "passed": passed,
        }
        for case, passed in stability(results)
    ]
