"""Closed loops for tests, simulated in worker processes: a test process never loads an FMU."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

from orchestrator.benchmark import cases, protocol
from orchestrator.benchmark.case import Case
from orchestrator.codec import pack
from orchestrator.exact_time import seconds
from orchestrator.execution.job import Job
from orchestrator.execution.messages import Failed, error_of
from orchestrator.execution.supervision import run_isolated
from orchestrator.fmi.archive import open_archive
from orchestrator.loop.scenario import Scenario
from orchestrator.loop.setup import Setup
from orchestrator.loop.trajectory import Trajectory
from orchestrator.pairing import work
from orchestrator.pairing.pairing import Pairing
from orchestrator.study.rehearsal import rehearse
from plant_fmu.flexible_manipulator.parameters import NOMINAL

T_S = Fraction(1, 4000)
PAPER = protocol.load("paper")
GRID = cases.grid(PAPER)


def quiet(duration: str | Fraction, parameters: Mapping[str, float] | None = None, **changes: Any) -> Scenario:
    """A scenario with all imperfections and disturbances off but those in ``changes``."""
    given = {"q_a_start[1]": 0.3, "q_a_start[2]": -0.9} if parameters is None else parameters
    return Scenario(tuple(given.items()), seconds(duration), **{"sample_time": T_S, **changes})


def case(index: int, system: str, test: str, seed: int = 0) -> Case:
    """A case of the protocol ``paper``."""
    return cases.case_named(PAPER, NOMINAL, seed, f"c{index:02d}.{system}.{test}")


def simulate_all(
    plant: Path,
    controller: Path,
    scenarios: Sequence[Scenario],
    observe: Sequence[str] = (),
    parameters: Mapping[str, float] | None = None,
) -> list[Trajectory]:
    """Trajectories of ``scenarios``, one worker process for all; raises what is raised there.

    ``observe`` names further plant outputs, ``parameters`` are the controller's.
    """
    tasks = [_task(scenario, parameters, observe) for scenario in scenarios]

    def decode(index: int, value: bytes) -> Trajectory:
        return work.trajectory(scenarios[index].samples, tuple(observe), value)

    return _run(plant, controller, "simulate_scenario", tasks, decode)


def probed(
    plant: Path, controller: Path, scenario: Scenario, parameters: Mapping[str, float] | None = None
) -> work.TimingRecord:
    """What the probe finds out about a controller in the steady state of ``scenario``."""
    own = Pairing(open_archive(plant), open_archive(controller), Setup(dict(parameters or {})))
    return rehearse(replace(case(0, "nominal", "disturbance"), scenario=scenario), own, compare=False).timing


def _task(scenario: Scenario, parameters: Mapping[str, float] | None, observe: Sequence[str] = ()) -> work.ScenarioTask:
    return work.ScenarioTask(Setup(dict(parameters or {})), scenario, tuple(observe))


def _run(
    plant: Path,
    controller: Path,
    function: str,
    tasks: Sequence[work.ScenarioTask],
    decode: Callable[[int, bytes], Any],
) -> list[Any]:
    largest = max(work.largest_trajectory(task.scenario) for task in tasks)
    archives = open_archive(plant), open_archive(controller)
    job = Job(*archives, f"{work.__name__}:{function}", tuple(map(pack, tasks)), (60.0,) * len(tasks), decode, largest)
    values = []
    for outcome in run_isolated(job):
        if isinstance(outcome, Failed):
            raise error_of(outcome.error)
        assert hasattr(outcome, "value"), outcome
        values.append(outcome.value)
    return values
