"""One case: simulated, or written for another tool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from ..benchmark import cases as case_list
from ..benchmark.case import Case
from ..benchmark.linearization import rest
from ..benchmark.metrics import named
from ..benchmark.scorecard import kind
from ..documents.files import write_bytes
from ..errors import InputError
from ..fmi.archive import open_archive
from ..pairing.built_in import built_in
from ..pairing.controller import Controller
from ..pairing.pairing import simulate_case
from ..pairing.plant import AUTO, NATIVE, PYTHON
from ..pairing.testbed import Testbed
from .simulation import Simulation

# Imports inside functions: lxml and Numba are loaded by those who need them.


def simulate(testbed: Testbed, controller: Controller, case: Case | str) -> Simulation:
    """See :meth:`.Benchmark.simulate`."""
    pairing, wanted = testbed.sampled(controller, case)
    scenario = wanted.scenario
    found = simulate_case(pairing, testbed.rules, wanted)
    result = named(wanted, found.judgement)
    plain = case_list.case(testbed.rules, wanted.configuration, wanted.system, wanted.test, testbed.seed).scenario
    varied = replace(plain, sample_time=scenario.sample_time) != scenario
    return Simulation(
        wanted, pairing.controller.name, found.trajectory, result, varied, kind(result, testbed.rules.stability)
    )


def export_ssp(testbed: Testbed, controller: Controller, case: Case | str, file: Path) -> None:
    """See :meth:`.Benchmark.export_ssp`."""
    from ..documents.ssp import package
    from ..loop.controller import Steady  # loads Numba

    if testbed.plant not in (AUTO, PYTHON, NATIVE):
        message = f"The package holds the benchmark's manipulator, in the place of {testbed.plant}: leave that out."
        raise InputError(message, "no-ssp", testbed.plant)
    pairing, wanted = testbed.sampled(controller, case)
    scenario, pose = wanted.scenario, wanted.configuration
    at = rest(dict(scenario.parameters), (pose.q_a1, pose.q_a2))
    plant, imperfections = (open_archive(built_in(name)) for name in ("FlexibleManipulatorNative", "Imperfections"))
    steady = Steady(at.q_m, at.u_m, at.q_a)
    write_bytes(file, package(plant, imperfections, pairing.controller, pairing.setup, scenario, steady))
