"""Closed loops for tests, simulated in child processes: a test process never loads an FMU."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from fractions import Fraction
from pathlib import Path
from typing import Any

from orchestrator.benchmark import protocol as protocols
from orchestrator.benchmark.case import Case
from orchestrator.cosim.archive import open_archive
from orchestrator.cosim.controller import Setup
from orchestrator.cosim.master import simulate
from orchestrator.cosim.scenario import Scenario, seconds
from orchestrator.cosim.slaves import Slave
from orchestrator.cosim.trajectory import Trajectory
from orchestrator.execution import isolation
from orchestrator.execution.job import Failed, Finished, Job
from plant_fmu.flexible_manipulator.parameters import NOMINAL

T_S = Fraction(1, 4000)
PAPER = protocols.load("paper")


def quiet(duration: str | Fraction, parameters: Mapping[str, float] | None = None, **changes: Any) -> Scenario:
    """A scenario with all imperfections and disturbances off but those in ``changes``."""
    given = {"q_a_start[1]": 0.3, "q_a_start[2]": -0.9} if parameters is None else parameters
    return Scenario(tuple(given.items()), seconds(duration), **{"sample_time": T_S, **changes})


def case(index: int, system: str, test: str, seed: int = 0) -> Case:
    """A case of the protocol ``paper``."""
    kind = PAPER.test(test)
    configuration = PAPER.grid[index]
    return protocols.case(PAPER, configuration, protocols.system(PAPER, NOMINAL, seed, index, system, kind), kind, seed)


def work(setup: Setup, observe: tuple[str, ...], plant: Slave, controller: Slave, scenario: Scenario) -> Trajectory:
    """What a child does with a scenario."""
    return simulate(plant, controller, scenario, setup, observe)


def simulate_all(
    plant: Path,
    controller: Path,
    scenarios: Sequence[Scenario],
    observe: Sequence[str] = (),
    parameters: Mapping[str, float] | None = None,
) -> list[Trajectory]:
    """Trajectories of ``scenarios``, one child process for all; raises what is raised there.

    ``observe`` names further plant outputs, ``parameters`` are the controller's.
    """
    job = Job(
        open_archive(plant),
        open_archive(controller),
        tuple(scenarios),
        functools.partial(work, Setup(dict(parameters or {})), tuple(observe)),
        tuple(60.0 for _ in scenarios),
    )
    trajectories = []
    for outcome in isolation.run_isolated(job):
        if isinstance(outcome, Failed):
            raise outcome.error
        assert isinstance(outcome, Finished), outcome
        trajectories.append(outcome.value)
    return trajectories
