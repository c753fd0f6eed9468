"""Cases over processes: groups of cases become jobs, outcomes become case results."""

from __future__ import annotations

import contextlib
import functools
import os
from collections.abc import Generator, Sequence
from dataclasses import replace
from typing import Any

from ..benchmark.case import Case
from ..benchmark.metrics import CaseResult, judge
from ..benchmark.protocol import Protocol
from ..cosim.archive import Archive
from ..cosim.controller import Setup, Steady
from ..cosim.master import simulate
from ..cosim.probe import Timing, probe
from ..cosim.scenario import Scenario
from ..cosim.slaves import Slave
from ..cosim.trajectory import Status, Trajectory
from ..errors import Crash, FmuError
from . import pool
from .job import Died, Failed, Finished, Job, Outcome

GROUP_SIZE = 9
"""Cases a child process runs before it is replaced: enough that its start (some 0.1 s) does not count."""


def available_cores() -> int:
    """Number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def time_limit(scenario: Scenario) -> float:
    """Wall time [s] a simulation may take: a minute for the start, and a tenth of real time."""
    return 60.0 + 10.0 * float(scenario.duration)


def evaluate(
    protocol: Protocol,
    cases: Sequence[Case],
    plant: Archive,
    controller: Archive,
    setup: Setup,
    workers: int,
) -> Generator[CaseResult, None, None]:
    """Results of ``cases`` as they come, in no particular order; each depends on its case and the FMUs alone."""
    groups = [cases[first : first + GROUP_SIZE] for first in range(0, len(cases), GROUP_SIZE)]
    work = functools.partial(_judged, protocol, setup)
    jobs = [
        Job(plant, controller, tuple(group), work, tuple(time_limit(case.scenario) for case in group))
        for group in groups
    ]
    for number, outcome in pool.run(jobs, workers):
        yield _result(groups[number][outcome.index], outcome)


def rehearse(case: Case, plant: Archive, controller: Archive, setup: Setup) -> Timing | None:
    """Simulate the first sample of ``case`` and probe the controller's timing.

    What is wrong with the input shows here, before anything else runs: raises
    :class:`~orchestrator.errors.BenchmarkError` where the FMUs cannot be connected or initialized or refuse the first
    step. It also leaves the compiled code of both in the cache, before several processes would compile it at once.
    Returns None where the controller crashes, which has a place in the results.
    """
    scenario = replace(case.scenario, duration=case.scenario.sample_time)
    job = Job(plant, controller, (scenario,), functools.partial(_rehearsed, setup), (time_limit(scenario),))
    for outcome in pool.run_isolated(job):
        if isinstance(outcome, Failed):
            raise outcome.error
        if isinstance(outcome, Finished):
            return outcome.value
    return None


def _rehearsed(setup: Setup, plant: Slave, controller: Slave, scenario: Scenario) -> Timing | None:
    trajectory = simulate(plant, controller, scenario, setup, ("q_a[1]", "q_a[2]"))
    ending = trajectory.ending
    if ending.status is Status.ERROR and ending.failed_call:
        raise FmuError(f"The first sample fails: {ending.message}", ending.failed_call)
    pose = (float(trajectory.extra["q_a[1]"][0]), float(trajectory.extra["q_a[2]"][0]))
    with contextlib.suppress(FmuError):  # a controller that cannot be probed may still be simulated
        return probe(controller, setup, Steady(trajectory.q_m_ref, trajectory.u_m0, pose), scenario.sample_time)
    return None


def simulate_isolated(
    scenario: Scenario,
    plant: Archive,
    controller: Archive,
    setup: Setup,
    observe: Sequence[str] = (),
) -> Trajectory:
    """One simulation in a process of its own.

    Raises the error of an FMU that fails before the first sample, :class:`Crash` where its process dies.
    """
    work = functools.partial(_simulated, setup, tuple(observe))
    job = Job(plant, controller, (scenario,), work, (time_limit(scenario),))
    for outcome in pool.run_isolated(job):
        if isinstance(outcome, Failed):
            raise outcome.error
        if isinstance(outcome, Died):
            raise Crash("\n  ".join((outcome.message, *outcome.output)))
        return outcome.value
    raise AssertionError("a job of one task has one outcome")


def _simulated(setup: Setup, observe: Sequence[str], plant: Slave, controller: Slave, scenario: Scenario) -> Trajectory:
    return simulate(plant, controller, scenario, setup, observe)


def _judged(protocol: Protocol, setup: Setup, plant: Slave, controller: Slave, case: Case) -> dict[str, Any]:
    return judge(protocol, case, simulate(plant, controller, case.scenario, setup))


def _result(case: Case, outcome: Outcome) -> CaseResult:
    if isinstance(outcome, Finished):
        return CaseResult(case, wall_time=outcome.wall_time, **outcome.value)
    if isinstance(outcome, Failed):
        return CaseResult(case, Status.ERROR, 0.0, str(outcome.error), wall_time=outcome.wall_time)
    status = Status.TIMEOUT if outcome.timeout else Status.CRASHED
    return CaseResult(case, status, 0.0, "\n  ".join((outcome.message, *outcome.output)), wall_time=outcome.wall_time)
