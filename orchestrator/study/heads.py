"""The head of a study's document: what it says of the controller, the plant and this machine."""

from __future__ import annotations

import platform
from collections.abc import Mapping
from fractions import Fraction
from importlib import metadata

from ..benchmark.protocol import Protocol
from ..benchmark.results import Rules, rules
from ..documents.head import BoundRecord, ControllerRecord, Head, PlantRecord, SampleTimeRecord, Timing
from ..documents.results import LoopDelay
from ..fmi.archive import Archive
from ..fmi.connectors import CONTROLLER
from ..fmi.host import wine
from ..fmi.library import WINE
from ..loop.behaviour import CarryOver, ComputingTime
from ..loop.setup import controller_binding, held_inputs
from ..pairing.built_in import FILE, Plant
from ..pairing.controller import Controller
from ..pairing.pairing import Pairing
from ..pairing.testbed import Testbed
from ..pairing.work import TimingRecord
from ..version import __version__
from .requests import Instant

LIBRARIES = ("fmpy", "pythonfmu", "numpy", "scipy", "numba")


def plant_record(plant: Plant, changes: Mapping[str, float]) -> PlantRecord:
    """The plant with ``changes`` of its nominal parameters."""
    nominal = {**plant.nominal, **changes}
    path = str(plant.archive.file) if plant.build == FILE else ""
    return PlantRecord(*_fmu(plant.archive), dict(changes), nominal, plant.build, plant.model, path)


def environment(controller: Archive) -> dict[str, str]:
    """Versions and platform that the numbers with this ``controller`` were made with."""
    return {
        "flexible_manipulator_benchmark": __version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": platform.machine(),
        **{library: metadata.version(library) for library in LIBRARIES},
        **({WINE: wine.version()} if controller.library == WINE else {}),
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
    used_as, library = (dict(setup.parameters), path, dict(setup.mapping), connectors), pairing.controller.library
    return ControllerRecord(
        *_fmu(pairing.controller), *used_as, library, held_inputs(pairing.controller, setup, binding)
    )


def loop_delay(protocol: Protocol, sample_time: Fraction, measured: TimingRecord) -> LoopDelay:
    """The loop delay with a controller of this ``sample_time`` [s], whose timing was ``measured``."""
    T_d, latency = protocol.loop.delay, measured.latency
    if latency is None:
        return LoopDelay(None, None, float(T_d), None, measured.convention)
    total = T_d + latency * sample_time
    return LoopDelay(float(total), float(total / sample_time), float(T_d), latency, measured.convention)


def _fmu(archive: Archive) -> tuple[str, str, str, str | None]:
    description = archive.description
    return archive.name, archive.sha256, str(description.fmiVersion), description.generationTool


def head(
    testbed: Testbed,
    controller: Controller,
    pairing: Pairing,
    sample_time: Fraction,
    begin: Instant,
    end: Instant,
    *,
    several_seeds: bool = False,
    computing_time: ComputingTime | None = None,
    own_rules: Rules | None = None,
) -> Head:
    """The head of what was made from ``begin`` to ``end``; ``own_rules`` stand in place of the protocol's."""
    protocol = testbed.rules
    return Head(
        benchmark=protocol.benchmark,
        protocol=protocol.name,
        protocol_file=str(testbed.protocol) if str(testbed.protocol) != protocol.name else "",
        seed=None if several_seeds else testbed.seed,
        controller=controller_record(pairing, controller),
        plant=plant_record(testbed.manipulator, testbed.plant_parameters),
        sample_time=SampleTimeRecord(float(sample_time), sample_time == protocol.sample_time),
        rules=rules(protocol) if own_rules is None else own_rules,
        # At the end: what repeating shows, it shows while cases run.
        carry_over=end.carry_over.get(pairing.controller.sha256, CarryOver.NOT_TESTED),
        environment=environment(pairing.controller),
        command=testbed.command,
        timing=Timing(
            start=begin.start,
            wall_time=end.seconds - begin.seconds,
            workers=begin.processes,
            simulations=end.simulations - begin.simulations,
            simulated_time=end.simulated_time - begin.simulated_time,
            simulation_time=end.simulation_time - begin.simulation_time,
            computing_time=computing_time,
        ),
    )
