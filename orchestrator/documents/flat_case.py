"""A case as plain numbers by name, from which the program of ``controller_fmu/closed_loop`` simulates and judges it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fractions import Fraction
from typing import Any

import numpy as np

from controller_fmu.export.one_program import FIGURES, IMPERFECTIONS, PLANT, Unit, block

from ..benchmark.case import JudgedCase
from ..benchmark.doubt import windows_left, with_latest_end
from ..benchmark.metrics import expected
from ..benchmark.protocol import JudgingTables
from ..codec import Struct
from ..fmi.archive import Archive
from ..loop.controller import Steady, start_values
from ..loop.scenario import Scenario
from ..loop.setup import Setup, controller_binding
from .ssp import imperfection_values, tick_of


class FlatCase(Struct):
    """By what a case is judged, and the parameters of plant and imperfections, but for the steady state, which the
    plant computes."""

    rules: dict[str, float]
    plant: dict[str, float]
    imperfections: dict[str, float]

    def block(
        self, units: Sequence[Unit], controller: str, values: Mapping[str, float], matrices: Sequence[float] = ()
    ) -> list[float]:
        """What the program reads for a ``controller``, one of its ``units``, with ``values`` of its parameters."""
        parts = ((PLANT, self.plant), (IMPERFECTIONS, self.imperfections), (controller, values))
        return block(units, self.rules, parts, matrices)


def flat_case(protocol: JudgingTables, case: JudgedCase) -> FlatCase:
    """The numbers of a case.

    Raises :class:`~orchestrator.errors.InputError` if it is none for the imperfections' FMU, as for an SSP package.
    """
    scenario, limits = case.scenario, protocol.stability
    names, latest = expected(protocol, case), with_latest_end(protocol, case)
    rules: dict[str, float | Fraction] = {
        "samples": scenario.samples,
        "latest": latest.samples,
        "numerator": scenario.sample_time.numerator,
        "denominator": scenario.sample_time.denominator,
        "ticks": scenario.sample_time / tick_of(scenario),
        "abort_distance": scenario.abort_distance,
        "chirp_start": scenario.chirp.start,
        "force_start": scenario.pulse.start,
        "force_stop": scenario.pulse.stop,
        "settling_error": protocol.settling.error,
        "recovery_error": limits.recovery_error,
        "rest_error": limits.rest_error,
        "rest_window": limits.rest_window,
        "limit_cycle": limits.limit_cycle,
        "limit_cycle_window": limits.limit_cycle_window,
        "limit_cycle_windows": limits.limit_cycle_windows,
        "ring_down": limits.ring_down,
        "doubtful": limits.doubtful,
        "dying": limits.dying,
        "left": windows_left(protocol, case),
        "asked": sum(1 << number for number, name in enumerate(FIGURES) if name in names),
    }
    return FlatCase(
        rules={name: float(value) for name, value in rules.items()},
        plant=dict(scenario.parameters),
        imperfections=imperfection_values(scenario),
    )


def controller_values(controller: Archive, setup: Setup, scenario: Scenario) -> dict[str, float]:
    """The parameters that a controller is given with a case, but for the steady state."""
    binding = controller_binding(controller, setup)
    at_rest = Steady((0.0, 0.0), (0.0, 0.0), (0.0, 0.0))
    before, within = start_values(controller, binding, setup, at_rest, scenario.sample_time)
    bound = {variable.name for connector in binding.values() for variable in connector.variables}
    given = {variable.name: values[0] for variable, values in (before | within).items()}
    return {name: float(value) for name, value in given.items() if name not in bound}


def flat_matrices(
    A: Any, B: Any, C: Any, D: Any, torque_limit: tuple[float, float] = (35.0, 20.0), anti_windup: Any = None
) -> list[float]:
    """The numbers of a linear controller behind a block, its matrices as those of ``controller_from_state_space``."""
    law = np.block([[np.asarray(A), np.asarray(B)], [np.asarray(C), np.asarray(D)]])
    states = len(law) - 2
    back = np.zeros((states, 2)) if anti_windup is None else np.asarray(anti_windup)
    numbers: list[float] = [*law.ravel().tolist(), *back.ravel().tolist()]
    return [float(states), *torque_limit, *numbers]
