"""Runs for tests of reports, made by hand: no simulation."""

from __future__ import annotations

from datetime import datetime, timezone
from pathlib import Path
from typing import Any

import numpy as np
from closed_loops import PAPER, T_S
from results import everything

from orchestrator.benchmark.scorecard import score
from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.controller import Setup
from orchestrator.report.recording import About, Recording, save
from orchestrator.report.results import Evaluation, Timing, document, write
from orchestrator.report.run import Run, load_run
from plant_fmu.flexible_manipulator.parameters import NOMINAL

TABLE_2 = {"B1": 0.17, "B2": 0.06, "B3": 9.6, "B4": 9.1, "B5": 10.2e-3, "B6": 3.5, "B7": 1.1e-3}
"""The paper's figures of its PID, which give V = 140.7."""


def evaluation(plant: Path, controller: Path, results=None, **changes: Any) -> Evaluation:
    """An evaluation with the paper's figures in all cases, or with ``results``."""
    found = everything(TABLE_2) if results is None else results
    values = {
        "protocol": PAPER,
        "seed": 0,
        "plant": open_archive(plant),
        "controller": open_archive(controller),
        "plant_parameters": {},
        "nominal": NOMINAL,
        "setup": Setup(),
        "sample_time": T_S,
        "controller_timing": None,
        "results": tuple(found),
        "scorecard": score(PAPER, found, 324),
        "timing": Timing(datetime(2026, 1, 2, tzinfo=timezone.utc), 100.0, 2),
    }
    return Evaluation(**{**values, **changes})


def recording(
    roles: tuple[str, ...], id: str = "c07.compliant.disturbance", size: float = 8e-3, **changes: Any
) -> Recording:
    """A recording of 26 s in which the TCP moves by ``size`` [m] along x at the beginning of the force, and by a tenth
    of it in the chirp."""
    about = {
        "id": id,
        "roles": roles,
        "configuration": 7,
        "q_a": (0.3, -0.9),
        "system": "compliant",
        "test": "disturbance",
        "duration": 26.0,
        "force": (300.0, 400.0),
        "window": (10.0, 10.5),
        "chirp": (0.5, 8.0, 0.0, 15.0),
        "u_m0": (1.0, 2.0),
        "status": "done",
        "time": 26.0,
        "message": "",
    }
    t = np.arange(0, 26, 0.01, dtype=np.float32)
    chirp = np.where((t > 0.5) & (t < 8), 0.1 * np.sin(2 * np.pi * t), 0)
    x = size * np.where(t > 10, np.exp(-2 * np.clip(t - 10, 0, None)), chirp)
    motion = np.column_stack([t, x, 0 * t, x / 2, x / 3]).astype(np.float32)
    torque = np.column_stack([t, np.sin(t), np.cos(t)]).astype(np.float32)
    return Recording(About(**{**about, **changes}), motion, torque)


RECORDINGS = (
    recording(("B5", "B6", "A3 x")),
    recording(("B7",), "c08.random_1.disturbance"),
    recording(("example",)),
    recording(("spread",)),
    recording(("spread",), "c07.random_1.disturbance", system="random_1"),
)


def stored(folder: Path, of: Evaluation, recordings: tuple[Recording, ...] = RECORDINGS) -> Run:
    """The run of an evaluation, written to ``folder`` and read back."""
    folder.mkdir(parents=True, exist_ok=True)
    write(document(of), folder)
    if recordings:
        save(recordings, folder)
    return load_run(folder)
