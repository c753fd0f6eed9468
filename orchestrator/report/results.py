"""The machine-readable results of an evaluation: ``results.json``, from which every report is made."""

from __future__ import annotations

import json
import platform
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
from ..cosim.connectors import CONTROLLER
from ..cosim.controller import Setup, controller_binding
from ..cosim.probe import Timing as ControllerTiming
from ..cosim.scenario import seconds
from .files import CASES, RESULTS, write_text
from .tables import csv_text

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
    """Everything an evaluation's report needs. ``results`` are in the protocol's order.

    ``plant_parameters`` are the user's changes by FMI name, ``nominal`` all nominal parameters with these applied (SI).
    """

    protocol: Protocol
    seed: int
    plant: Archive
    controller: Archive
    plant_parameters: Mapping[str, float]
    nominal: Mapping[str, float]
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
        "criteria": {
            score.criterion.name: _criterion(score, evaluation.results, protocol.reference[score.criterion.name])
            for score in card.criteria
        },
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
        "controller": {
            **_fmu(evaluation.controller),
            "parameters": dict(evaluation.setup.parameters),
            "mapping": dict(evaluation.setup.mapping),
            "connectors": _connectors(evaluation.controller, evaluation.setup),
        },
        "plant": {
            **_fmu(evaluation.plant),
            "parameters": dict(evaluation.plant_parameters),
            "nominal": dict(evaluation.nominal),
        },
        "rules": rules(protocol),
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


def rules(protocol: Protocol) -> dict[str, Any]:
    """What the protocol asks for, as far as a reader of the results needs it; SI units."""
    raw = protocol.raw
    return {
        "cost": {"target": sum(criterion.weight for criterion in protocol.criteria), "paper": protocol.reference["V"]},
        "stability": {key: value for key, value in raw["stability"].items() if key != "systems"},
        "settling_error": raw["settling"]["error"],
        "torque_limit": list(raw["loop"]["torque_limit"]),
        "tests": [
            {
                "name": test.name,
                "axis": test.axis,
                "gain": test.gain,
                "delay": float(test.delay),
                "criteria": list(test.criteria),
                "requirements": list(test.requirements),
            }
            for test in protocol.tests
        ],
    }


def write(contents: Mapping[str, Any], folder: Path) -> None:
    """Write ``cases.csv`` and ``results.json`` into ``folder``, each in one go, the summary last."""
    write_text(folder / CASES, csv_text(contents))
    write_text(folder / RESULTS, json.dumps(contents, indent=1, allow_nan=False) + "\n")


def _criterion(score: CriterionScore, results: Sequence[CaseResult], reference: float) -> dict[str, Any]:
    worst = next((result for result in results if result.case.id == score.worst_case), None)
    return {
        "value": score.value,
        "target": score.criterion.target,
        "weight": score.criterion.weight,
        "unit": score.criterion.unit,
        "title": score.criterion.title,
        "paper": reference,
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
    return {
        "passed": verdict.passed,
        "limit_cycle": verdict.amplitude,
        "rest_error": verdict.rest_error,
        "worst_case": verdict.worst_case,
    }


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


def _connectors(controller: Archive, setup: Setup) -> dict[str, Any]:
    """Which variables each connector is bound to, how they were found, and what could not be checked; None where an
    optional one is absent."""
    binding = controller_binding(controller, setup)
    return {
        connector.name: None
        if (bound := binding.get(connector.name)) is None
        else {
            "variables": [variable.name for variable in bound.variables],
            "found": bound.spelled,
            "notes": list(bound.notes),
        }
        for connector in CONTROLLER
    }


def _fmu(archive: Archive) -> dict[str, Any]:
    return {
        "file": archive.name,
        "sha256": archive.sha256,
        "fmi_version": archive.description.fmiVersion,
        "generation_tool": archive.description.generationTool,
    }
