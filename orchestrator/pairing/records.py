"""From the runs of an evaluation to its results: everything ``results.json`` says."""

from __future__ import annotations

import platform
from collections.abc import Mapping, Sequence
from fractions import Fraction
from importlib import metadata

from ..benchmark.protocol import Protocol
from ..benchmark.results import (
    SCHEMA,
    BoundRecord,
    CaseResult,
    ControllerRecord,
    LoopDelay,
    PlantRecord,
    Results,
    RunTiming,
    SampleTimeRecord,
    rules,
)
from ..benchmark.scorecard import score
from ..fmi.archive import Archive
from ..fmi.connectors import CONTROLLER
from ..loop.setup import controller_binding
from ..version import __version__
from .controller import Controller
from .pairing import Pairing
from .plant import FILE, Plant
from .work import TimingRecord

LIBRARIES = ("fmpy", "pythonfmu", "numpy", "scipy", "numba")


def results(
    protocol: Protocol,
    protocol_file: str,
    seed: int,
    pairing: Pairing,
    controller: Controller,
    plant: PlantRecord,
    sample_time: Fraction,
    measured: TimingRecord,
    cases: Sequence[CaseResult],
    timing: RunTiming,
) -> Results:
    """The results of an evaluation of ``cases``, in their order.

    ``measured`` is the controller's timing.
    """
    spec = rules(protocol)
    card = score(spec, cases)
    return Results(
        schema=SCHEMA,
        benchmark=protocol.benchmark,
        protocol=protocol.name,
        protocol_file=protocol_file,
        complete=card.complete,
        cost=card.cost,
        criteria=card.criteria,
        stability=card.stability,
        configurations=card.configurations,
        cases=tuple(cases),
        seed=seed,
        controller=controller_record(pairing, controller),
        plant=plant,
        rules=spec,
        sample_time=SampleTimeRecord(float(sample_time), sample_time == protocol.sample_time),
        loop_delay=_loop_delay(protocol, sample_time, measured),
        environment=environment(),
        timing=timing,
    )


def plant_record(plant: Plant, changes: Mapping[str, float]) -> PlantRecord:
    """The plant with ``changes`` of its nominal parameters."""
    nominal = {**plant.nominal, **changes}
    path = str(plant.archive.file) if plant.build == FILE else ""
    return PlantRecord(*_fmu(plant.archive), dict(changes), nominal, plant.build, plant.model, path)


def environment() -> dict[str, str]:
    """Versions and platform that the numbers were made with."""
    return {
        "flexible_manipulator_benchmark": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        **{library: metadata.version(library) for library in LIBRARIES},
    }


def controller_record(pairing: Pairing, controller: Controller) -> ControllerRecord:
    """The controller as it is used."""
    binding = controller_binding(pairing.controller, pairing.setup)
    connectors = {
        connector.name: BoundRecord(tuple(v.name for v in bound.variables), bound.spelled, bound.notes)
        if (bound := binding.get(connector.name))
        else None
        for connector in CONTROLLER
    }
    path = "" if controller.file is None else str(controller.file)
    setup = pairing.setup
    return ControllerRecord(*_fmu(pairing.controller), dict(setup.parameters), path, dict(setup.mapping), connectors)


def _loop_delay(protocol: Protocol, sample_time: Fraction, measured: TimingRecord) -> LoopDelay:
    T_d, latency = protocol.loop.delay, measured.latency
    if latency is None:
        return LoopDelay(None, None, float(T_d), None, measured.convention)
    total = T_d + latency * sample_time
    return LoopDelay(float(total), float(total / sample_time), float(T_d), latency, measured.convention)


def _fmu(archive: Archive) -> tuple[str, str, str, str | None]:
    description = archive.description
    return archive.name, archive.sha256, str(description.fmiVersion), description.generationTool
