"""Cases over processes: groups of cases become jobs, outcomes become case results."""

from __future__ import annotations

import contextlib
import functools
import os
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace
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
from ..cosim.trace import CONTROLLER, PLANT, Place
from ..cosim.trajectory import Status, Trajectory
from ..errors import Crash, FmuError
from .isolation import run_isolated
from .job import Died, Failed, Finished, Job, Limits, Outcome

GROUP_SIZE = 9
"""Cases a child process runs before it is replaced: enough that its start does not count, few enough
that leaks of FMPy and of FMUs do not either."""

STRIKES = 3
"""Failures of one kind after which a controller's remaining cases are skipped."""

FULL_LENGTH = 26.0
"""Simulated time [s] that a time limit is given for; shorter simulations get their share."""

START_TIME = 5.0
"""Wall time [s] for instantiation and initialization, on top of the share."""

FIRST_START_TIME = 30.0
"""The same where compiled code may be missing from the cache, at the least."""

Execute = Callable[[Sequence[Job]], Generator[tuple[int, Outcome], None, None]]
"""Runs jobs somewhere; yields (number of the job, outcome) as they come."""


@dataclass(frozen=True)
class Bench:
    """The two FMUs and the conditions they run under.

    ``timeout`` is the wall time [s] a simulation of FULL_LENGTH may take.
    """

    plant: Archive
    controller: Archive
    setup: Setup = field(default_factory=Setup)
    timeout: float = 60.0
    limits: Limits = field(default_factory=Limits)
    sandbox: bool = False

    def job(self, tasks: Sequence[Any], scenarios: Sequence[Scenario], work: Callable[..., Any], start: float) -> Job:
        """A job of this bench: one scenario a task for the time limits."""
        limits = tuple(start + self.timeout * float(scenario.duration) / FULL_LENGTH for scenario in scenarios)
        return Job(self.plant, self.controller, tuple(tasks), work, limits, self.limits, self.sandbox)


def available_cores() -> int:
    """Number of processors this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def evaluate(
    protocol: Protocol,
    cases: Sequence[Case],
    bench: Bench,
    execute: Execute,
    failures: Sequence[CaseResult] = (),
    keep_going: bool = False,
    at_once: CaseResult | None = None,
) -> Generator[CaseResult, None, None]:
    """Results of ``cases`` as they come, in no particular order; each depends on its case and the FMUs alone.

    After STRIKES failures of one kind, those of earlier ``failures`` counted, the remaining cases are skipped unless
    ``keep_going``. A failure ``at_once``, which the rehearsal has found, is enough alone.
    """
    strikes = Counter((result.status, result.kind) for result in failures)
    groups = [cases[first : first + GROUP_SIZE] for first in range(0, len(cases), GROUP_SIZE)]
    work = functools.partial(_judged, protocol, bench.setup)
    jobs = [bench.job(group, [case.scenario for case in group], work, START_TIME) for group in groups]
    waiting = dict.fromkeys(cases)
    reason = _reason(strikes, at_once, keep_going)
    if at_once is not None and at_once.case in waiting and not keep_going:
        del waiting[at_once.case]
        yield at_once
    if not reason:
        with contextlib.closing(execute(jobs)) as outcomes:
            for number, outcome in outcomes:
                case = groups[number][outcome.index]
                if case not in waiting:
                    continue  # a cluster may run a job twice
                del waiting[case]
                result = case_result(case, outcome)
                yield result
                strikes[result.status, result.kind] += 1
                reason = _reason(strikes, at_once, keep_going)
                if reason:
                    break
    for case in waiting:
        yield CaseResult(case, Status.SKIPPED, 0.0, reason)


@dataclass(frozen=True)
class Rehearsal:
    """What the first sample has shown: the controller's ``timing``, None where it cannot be probed, and the result of
    the case where its process has not come through the first sample: no case can then be expected to."""

    timing: Timing | None = None
    failure: CaseResult | None = None


def rehearse(case: Case, bench: Bench) -> Rehearsal:
    """Simulate the first sample of ``case``, then probe the controller's timing.

    What is wrong with the input shows here, before anything else runs: raises
    :class:`~orchestrator.errors.BenchmarkError` where the FMUs cannot be connected or initialized or refuse the first
    step. It also leaves the compiled code of both in the cache, before several processes would compile it at once.
    """
    scenario = replace(case.scenario, duration=case.scenario.sample_time)
    start = max(FIRST_START_TIME, 0.5 * bench.timeout)  # who gives cases more time has a controller that needs it
    work = functools.partial(_rehearsed, bench.setup)
    timing = None
    for outcome in run_isolated(bench.job([(scenario, False), (scenario, True)], [scenario] * 2, work, start)):
        if isinstance(outcome, Failed):
            raise outcome.error
        if isinstance(outcome, Finished):
            timing = outcome.value
        elif outcome.index == 0 and outcome.place.sample == 0 and not outcome.outside:
            return Rehearsal(failure=case_result(case, outcome))
    return Rehearsal(timing)


def simulate_isolated(scenario: Scenario, bench: Bench, observe: Sequence[str] = ()) -> Trajectory:
    """One simulation in a process of its own.

    Raises the error of an FMU that fails before the first sample, :class:`Crash` where its process dies.
    """
    work = functools.partial(_simulated, bench.setup, tuple(observe))
    for outcome in run_isolated(bench.job([scenario], [scenario], work, FIRST_START_TIME)):
        if isinstance(outcome, Failed):
            raise outcome.error
        if isinstance(outcome, Died):
            raise Crash(_told(outcome, scenario))
        return outcome.value
    raise AssertionError("a job of one task has one outcome")


def case_result(case: Case, outcome: Outcome) -> CaseResult:
    """The result of a case from what its process had to say, or left behind."""
    if isinstance(outcome, Finished):
        kind = _first_line(outcome.value["message"]) if outcome.value["status"] is Status.ERROR else ""
        return CaseResult(case, wall_time=outcome.wall_time, kind=kind, **outcome.value)
    wall_time = outcome.wall_time
    if isinstance(outcome, Failed):
        message, call = str(outcome.error), getattr(outcome.error, "call", "")
        kind = f"{call} failed" if call else _first_line(message)
        # Errors are raised before the first sample; a trajectory tells those that come later.
        return CaseResult(case, Status.ERROR, 0.0, message, wall_time=wall_time, kind=kind)
    status = Status.TIMEOUT if outcome.timeout else Status.CRASHED
    time = float(outcome.place.sample * case.scenario.sample_time)
    message, final = _told(outcome, case.scenario), not outcome.outside
    return CaseResult(case, status, time, message, wall_time=wall_time, final=final, kind=outcome.kind)


def _rehearsed(setup: Setup, plant: Slave, controller: Slave, task: tuple[Scenario, bool]) -> Timing | None:
    """One sample, and where the task says so the timing. These are two tasks, since a crash of the probe, which takes
    further instances, is no verdict on the controller."""
    scenario, with_timing = task
    trajectory = simulate(plant, controller, scenario, setup, ("q_a[1]", "q_a[2]"))
    ending = trajectory.ending
    if ending.status is Status.ERROR and ending.failed_call:
        raise FmuError(f"The first sample fails: {ending.message}", ending.failed_call)
    if not with_timing:
        return None
    pose = (float(trajectory.extra["q_a[1]"][0]), float(trajectory.extra["q_a[2]"][0]))
    with contextlib.suppress(FmuError):  # a controller that cannot be probed may still be simulated
        return probe(controller, setup, Steady(trajectory.q_m_ref, trajectory.u_m0, pose), scenario.sample_time)
    return None


def _simulated(setup: Setup, observe: Sequence[str], plant: Slave, controller: Slave, scenario: Scenario) -> Trajectory:
    return simulate(plant, controller, scenario, setup, observe)


def _judged(protocol: Protocol, setup: Setup, plant: Slave, controller: Slave, case: Case) -> dict[str, Any]:
    return judge(protocol, case, simulate(plant, controller, case.scenario, setup))


def _told(death: Died, scenario: Scenario) -> str:
    """How a process died, where its simulation was, and what it had printed."""
    return "\n  ".join((f"{death.message}, {_whereabouts(death.place, scenario)}", *death.output))


def _whereabouts(place: Place, scenario: Scenario) -> str:
    who = {PLANT: "the plant", CONTROLLER: "the controller"}.get(place.side)
    if who is None:
        return "outside any FMI call"
    return f"in the call '{place.call}' of {who} at t = {float(place.sample * scenario.sample_time):g} s"


def _first_line(message: str) -> str:
    return message.split("\n")[0]


def _reason(strikes: Counter[tuple[Status, str]], at_once: CaseResult | None, keep_going: bool) -> str:
    """Why no more cases are run; empty while they are."""
    if keep_going:
        return ""
    way_out = "--keep-going runs all, those that failed again"
    if at_once is not None:
        return f"skipped after a failure in the first sample ({at_once.status.value}: {at_once.kind}); {way_out}"
    for (status, kind), count in strikes.items():
        if kind and count >= STRIKES:
            return f"skipped after {count} failures of one kind ({status.value}: {kind}); {way_out}"
    return ""
