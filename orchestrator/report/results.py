"""The machine-readable results of an evaluation: ``results.json`` and ``cases.csv``."""

from __future__ import annotations

import csv
import io
import json
import os
import platform
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import datetime, timezone
from fractions import Fraction
from importlib import metadata
from pathlib import Path
from typing import Any

from .. import __version__
from ..benchmark.metrics import CaseResult
from ..benchmark.protocol import Protocol
from ..benchmark.scorecard import CriterionScore, Requirement, Scorecard, Verdict
from ..cosim.archive import Archive
from ..cosim.controller import Setup
from ..cosim.probe import Timing as ControllerTiming
from ..cosim.scenario import seconds
from ..errors import InputError

SCHEMA = "flexible-manipulator-results/1"

LIBRARIES = ("fmpy", "pythonfmu", "numpy", "scipy", "numba")


@dataclass(frozen=True)
class Timing:
    """When an evaluation began, how long it took [s], and on how many processes."""

    start: datetime
    wall_time: float
    workers: int


@dataclass(frozen=True)
class Evaluation:
    """Everything an evaluation's report needs. ``results`` are in the protocol's order."""

    protocol: Protocol
    seed: int
    plant: Archive
    controller: Archive
    plant_parameters: Mapping[str, float]
    setup: Setup
    sample_time: Fraction
    controller_timing: ControllerTiming | None
    results: tuple[CaseResult, ...]
    scorecard: Scorecard
    timing: Timing


def document(evaluation: Evaluation) -> dict[str, Any]:
    """The contents of ``results.json``. All values in SI units; None (null) where there is no value."""
    protocol, card = evaluation.protocol, evaluation.scorecard
    return {
        "schema": SCHEMA,
        "benchmark": protocol.benchmark,
        "protocol": protocol.name,
        "complete": card.complete,
        "cost": card.cost,
        "criteria": {score.criterion.name: _criterion(score, evaluation.results) for score in card.criteria},
        "stability": {requirement.name: _requirement(requirement) for requirement in card.requirements},
        "configurations": [
            {
                "index": score.configuration.index,
                "q_a1": score.configuration.q_a1,
                "q_a2": score.configuration.q_a2,
                "cost": score.cost,
                "relative": score.relative,
            }
            for score in card.configurations
        ],
        "cases": [_case(result) for result in evaluation.results],
        "controller": {**_fmu(evaluation.controller), "parameters": dict(evaluation.setup.parameters)},
        "plant": {**_fmu(evaluation.plant), "parameters": dict(evaluation.plant_parameters)},
        "seed": evaluation.seed,
        "sample_time": {
            "seconds": float(evaluation.sample_time),
            "as_in_benchmark": evaluation.sample_time == protocol.sample_time,
        },
        "loop_delay": loop_delay(evaluation),
        "environment": environment(),
        "timing": {
            "start": evaluation.timing.start.astimezone(timezone.utc).isoformat(timespec="seconds"),
            "wall_time": evaluation.timing.wall_time,
            "workers": evaluation.timing.workers,
            "simulated_time": sum(result.time for result in evaluation.results),
            "simulation_time": sum(result.wall_time for result in evaluation.results),
        },
    }


def loop_delay(evaluation: Evaluation) -> dict[str, Any]:
    """From a measurement to the torque at the motor: the benchmark's T_d and the controller's own latency.

    "seconds" and "samples" are None where the latency could not be measured.
    """
    timing = evaluation.controller_timing
    T_d, T_s = seconds(evaluation.protocol.raw["loop"]["delay"]), evaluation.sample_time
    latency = timing.latency if timing is not None else None
    total = None if latency is None else T_d + latency * T_s
    return {
        "seconds": None if total is None else float(total),
        "samples": None if total is None else float(total / T_s),
        "benchmark": float(T_d),
        "controller_samples": latency,
        "convention": timing.convention.value if timing is not None else None,
    }


def environment() -> dict[str, str]:
    """Versions and platform that the numbers were made with."""
    return {
        "flexible_manipulator_benchmark": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        **{library: metadata.version(library) for library in LIBRARIES},
    }


def csv_text(results: Sequence[CaseResult], criteria: Sequence[tuple[str, str]]) -> str:
    """The contents of ``cases.csv``, one row a case; ``criteria`` are pairs of name and unit."""
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(
        [
            *("id", "status", "configuration", "q_a1 [rad]", "q_a2 [rad]", "system", "test", "time [s]"),
            *(f"{name} [{unit}]" for name, unit in criteria),
            *("settled", "limit_cycle_x [m]", "limit_cycle_z [m]", "rest_error [m]", "warnings", "message"),
        ]
    )
    for result in results:
        row = _case(result)
        figures = row["measurements"]
        pose = row["configuration"]
        writer.writerow(
            [
                *(row["id"], row["status"], pose["index"], pose["q_a1"], pose["q_a2"], row["system"], row["test"]),
                row["time"],
                *(figures.get(name) for name, _ in criteria),
                *(figures.get(key) for key in ("settled", "limit_cycle_x", "limit_cycle_z", "rest_error")),
                *(row["warnings"], row["message"]),
            ]
        )
    return stream.getvalue()


def write(evaluation: Evaluation, folder: Path) -> None:
    """Write ``cases.csv`` and ``results.json`` into ``folder``, each in one go, the summary last."""
    criteria = [(criterion.name, criterion.unit) for criterion in evaluation.protocol.criteria]
    write_text(folder / "cases.csv", csv_text(evaluation.results, criteria))
    write_text(folder / "results.json", json.dumps(document(evaluation), indent=1, allow_nan=False) + "\n")


def prepare_folder(folder: Path) -> None:
    """Create ``folder``; raises :class:`InputError` where it cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        raise InputError(
            f"The output folder {folder} cannot be written to: {problem.strerror}. Choose another with --output-dir."
        ) from problem


def write_text(file: Path, text: str) -> None:
    """Write a file in one go: under its name there is the old contents or the new, never a part."""
    scratch = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        scratch.write_text(text, encoding="utf-8", newline="")
        os.replace(scratch, file)
    finally:
        scratch.unlink(missing_ok=True)


def _criterion(score: CriterionScore, results: Sequence[CaseResult]) -> dict[str, Any]:
    worst = next((result for result in results if result.case.id == score.worst_case), None)
    return {
        "value": score.value,
        "target": score.criterion.target,
        "weight": score.criterion.weight,
        "unit": score.criterion.unit,
        "share": score.share,
        "worst_case": None
        if worst is None
        else {
            "id": worst.case.id,
            "value": score.worst_value,
            "configuration": worst.case.configuration.index,
            "system": worst.case.system.name,
        },
    }


def _requirement(requirement: Requirement) -> dict[str, Any]:
    return {
        **_verdict(requirement.overall),
        "axes": {axis: _verdict(verdict) for axis, verdict in requirement.axes.items()},
    }


def _verdict(verdict: Verdict) -> dict[str, Any]:
    return {"passed": verdict.passed, "limit_cycle": verdict.amplitude, "worst_case": verdict.worst_case}


def _case(result: CaseResult) -> dict[str, Any]:
    case, measurement = result.case, result.measurement
    figures: dict[str, Any] = {}
    if measurement is not None:
        figures.update(measurement.criteria)
        if measurement.settled is not None:
            figures["settled"] = measurement.settled
        if measurement.limit_cycle is not None:
            figures["limit_cycle_x"], figures["limit_cycle_z"] = measurement.limit_cycle
            figures["rest_error"] = measurement.rest_error
    return {
        "id": case.id,
        "status": result.status.value,
        "configuration": {
            "index": case.configuration.index,
            "q_a1": case.configuration.q_a1,
            "q_a2": case.configuration.q_a2,
        },
        "system": case.system.name,
        "test": case.test.name,
        "measurements": figures,
        "time": result.time,
        "message": result.message,
        "warnings": result.warnings,
    }


def _fmu(archive: Archive) -> dict[str, Any]:
    return {
        "file": archive.name,
        "sha256": archive.sha256,
        "fmi_version": archive.description.fmiVersion,
        "generation_tool": archive.description.generationTool,
    }
