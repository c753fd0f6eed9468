"""The head of a study's document."""

from __future__ import annotations

from fractions import Fraction

from ..benchmark.results import Rules, rules
from ..documents.head import Head, SampleTimeRecord, Timing
from ..loop.behaviour import CarryOver, ComputingTime
from ..pairing import records
from ..pairing.controller import Controller
from ..pairing.pairing import Pairing
from ..pairing.testbed import Testbed
from .requests import Instant


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
        controller=records.controller_record(pairing, controller),
        plant=records.plant_record(testbed.manipulator, testbed.plant_parameters),
        sample_time=SampleTimeRecord(float(sample_time), sample_time == protocol.sample_time),
        rules=rules(protocol) if own_rules is None else own_rules,
        # At the end: what repeating shows, it shows while cases run.
        carry_over=end.carry_over.get(pairing.controller.sha256, CarryOver.NOT_TESTED),
        environment=records.environment(pairing.controller),
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
