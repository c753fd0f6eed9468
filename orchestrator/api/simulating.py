"""One case: simulated, or written for another tool."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from ..benchmark import cases as case_list
from ..benchmark.case import Case
from ..benchmark.linearization import rest
from ..benchmark.metrics import AT_THE_END, case_result
from ..benchmark.results import rules
from ..benchmark.scorecard import kind
from ..documents.files import check_result, write_bytes
from ..errors import InputError
from ..fmi.archive import open_archive
from ..loop.trajectory import Status
from ..pairing.built_in import built_in
from ..pairing.controller import Controller
from ..pairing.pairing import simulate_case
from ..pairing.plant import AUTO, NATIVE, PYTHON
from ..pairing.testbed import Testbed
from .simulation import Simulation

if TYPE_CHECKING:
    from ..documents.ssp import Order

# Imports inside functions: lxml and Numba are loaded by those who need them.


def simulate(testbed: Testbed, controller: Controller, case: Case | str) -> Simulation:
    """See :meth:`.Benchmark.simulate`."""
    pairing, sampled = testbed.sampled(controller, case)
    scenario = sampled.scenario
    simulated = simulate_case(pairing, testbed.rules, sampled)
    ending, cut_short = simulated.trajectory.ending, scenario.duration < sampled.test.duration
    result = case_result(sampled, simulated.judgement)
    if cut_short:  # what is judged at the end of a test is judged at another time here, which means nothing
        figures = msgspec.structs.replace(result.measurements, **dict.fromkeys(AT_THE_END))
        changes = {"status": ending.status, "message": ending.message, "measurements": figures, "judged_until": None}
        result = msgspec.structs.replace(result, **changes)
    plain = case_list.case(testbed.rules, sampled.configuration, sampled.system, sampled.test, testbed.seed).scenario
    # The controller's sample time alone makes no other case: an evaluation has it, too.
    varied = replace(plain, sample_time=scenario.sample_time) != scenario
    verdict = "no verdict" if cut_short and ending.status is Status.DONE else kind(result, testbed.rules.stability)
    return Simulation(
        sampled,
        pairing.controller.name,
        simulated.trajectory,
        result,
        varied,
        verdict,
        rules(testbed.rules),
        cut_short,
    )


def export_ssp(testbed: Testbed, controller: Controller, case: Case | str, file: Path, order: Order) -> None:
    """See :meth:`.Benchmark.export_ssp`."""
    from ..documents.ssp import package
    from ..loop.controller import Steady  # loads Numba

    check_result(file)
    if testbed.plant not in (AUTO, PYTHON, NATIVE):
        message = f"The package holds the benchmark's manipulator, in the place of {testbed.plant}: leave that out."
        raise InputError(message, "no-ssp", testbed.plant)
    pairing, sampled = testbed.sampled(controller, case)
    scenario, pose = sampled.scenario, sampled.configuration
    at = rest(dict(scenario.parameters), (pose.q_a1, pose.q_a2))
    plant, imperfections = (open_archive(built_in(name)) for name in ("FlexibleManipulatorNative", "Imperfections"))
    steady = Steady(at.q_m, at.u_m, at.q_a)
    write_bytes(file, package(plant, imperfections, pairing.controller, pairing.setup, scenario, steady, order))
