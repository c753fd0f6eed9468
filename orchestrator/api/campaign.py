"""Many cases over processes: groups of cases become jobs, outcomes become results."""

from __future__ import annotations

import contextlib
import json
from collections import Counter
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field, replace

from msgspec import structs

from ..benchmark.case import Case
from ..benchmark.metrics import named
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, Judgement
from ..codec import Struct, pack, unpack
from ..errors import Crash
from ..execution.job import Died, Done, Job, Limits, Outcome
from ..execution.messages import error_of
from ..execution.supervision import run_isolated
from ..fmi.archive import Archive
from ..fmi.trace import CONTROLLER, PLANT, Place
from ..loop.computing import ComputingTime
from ..loop.scenario import Scenario
from ..loop.setup import Setup
from ..loop.trajectory import Status, Trajectory
from ..reporting.recording import OBSERVED
from . import work

GROUP_SIZE = 9
"""Cases a worker runs before it is replaced: enough that its start does not count, few enough that leaks of FMPy and
of FMUs do not either."""

STRIKES = 3
"""Failures of one kind after which a controller's remaining cases are skipped."""

FULL_LENGTH = 26.0
"""Simulated time [s] that a time limit is given for; shorter simulations get their share."""

START_TIME = 5.0
"""Seconds for instantiation and initialization, on top of the share."""

FIRST_START_TIME = 60.0
"""The same where compiled code may be missing from the cache, at the least."""

Execute = Callable[[Sequence[Job]], Generator[tuple[int, Outcome], None, None]]
"""Runs jobs somewhere; yields (number of the job, outcome) as they come."""


@dataclass(frozen=True)
class Bench:
    """The two FMUs and the conditions they run under.

    ``timeout`` is the processor time [s] that a simulation of FULL_LENGTH may take. If ``apart``, the process of plant
    and judge never loads the controller.
    """

    plant: Archive
    controller: Archive
    setup: Setup = field(default_factory=Setup)
    timeout: float = 60.0
    limits: Limits = field(default_factory=Limits)
    sandbox: bool = False
    apart: bool = False

    def job(
        self,
        function: str,
        tasks: Sequence[Struct],
        scenarios: Sequence[Scenario],
        decode: Callable[[int, bytes], object],
        start: float,
        largest: int = 1 << 16,
    ) -> Job:
        """A job of this bench: ``function`` of :mod:`.work` with one scenario per task for the time limits, on top of
        ``start`` [s]."""
        limits = tuple(start + self.timeout * float(scenario.duration) / FULL_LENGTH for scenario in scenarios)
        return self.raw_job(f"{work.__name__}:{function}", tasks, limits, decode, largest)

    def raw_job(
        self,
        function: str,
        tasks: Sequence[Struct],
        time_limits: tuple[float, ...],
        decode: Callable[[int, bytes], object],
        largest: int = 1 << 16,
    ) -> Job:
        """A job of this bench with any function ("module:name") and time limits [s]."""
        packed = tuple(map(pack, tasks))
        own = (self.limits, self.sandbox, self.apart)
        return Job(self.plant, self.controller, function, packed, time_limits, decode, largest, *own)

    @property
    def conditions(self) -> str:
        """What a failure may depend on beside its key: limits, and whether there is a sandbox."""
        return json.dumps([self.timeout, self.limits.memory, self.limits.output, self.sandbox, self.apart])


@dataclass(frozen=True)
class CaseRun:
    """A case with its result, and the wall time [s] it took. ``kind`` is what went wrong without figures, the same for
    equal failures; empty if nothing did."""

    case: Case
    result: CaseResult
    wall_time: float = 0.0
    kind: str = ""


@dataclass(frozen=True)
class Rehearsal:
    """What the first sample has shown: the controller's ``timing``, and the run of the case if its process has not come
    through the first sample: no case can then be expected to."""

    timing: work.TimingRecord = field(default_factory=work.TimingRecord)
    failure: CaseRun | None = None


def run_cases(
    protocol: Protocol,
    cases: Sequence[Case],
    bench: Bench,
    execute: Execute,
    failures: Sequence[CaseRun] = (),
    keep_going: bool = False,
    at_once: CaseRun | None = None,
) -> Generator[tuple[int, CaseRun], None, None]:
    """Runs of ``cases`` as they come, each with the number of its case, in no particular order; a run depends on its
    case and the FMUs alone.

    After STRIKES failures of one kind, those of earlier ``failures`` included, the remaining cases are skipped unless
    ``keep_going``. A failure ``at_once``, which the rehearsal has found, is enough alone.
    """
    strikes = Counter((run.result.status, run.kind) for run in failures)
    jobs = [judging(protocol, cases[first : first + GROUP_SIZE], bench) for first in range(0, len(cases), GROUP_SIZE)]
    waiting = dict.fromkeys(range(len(cases)))
    reason = _reason(strikes, at_once, keep_going)
    if at_once is not None and at_once.case in cases and not keep_going:
        number = cases.index(at_once.case)
        del waiting[number]
        yield number, at_once
    if not reason:
        with contextlib.closing(execute(jobs)) as outcomes:
            for job, outcome in outcomes:
                number = job * GROUP_SIZE + outcome.index
                if number not in waiting:
                    continue  # a cluster may run a job twice
                del waiting[number]
                run = case_run(cases[number], outcome)
                yield number, run
                strikes[run.result.status, run.kind] += 1
                reason = _reason(strikes, at_once, keep_going)
                if reason:
                    break
    for number in waiting:
        skipped = Judgement(status=Status.SKIPPED, time=0.0, message=reason)
        yield number, CaseRun(cases[number], named(cases[number], skipped))


def simulate(bench: Bench, scenario: Scenario) -> Trajectory:
    """The trajectory of ``scenario``, simulated in a process of its own.

    Raises :class:`FmuError` if an FMU fails before the first sample, :class:`Crash` if the process ends before the
    simulation.
    """
    job = bench.job(
        work.simulate_scenario.__name__,
        [work.ScenarioTask(bench.setup, scenario, OBSERVED)],
        [scenario],
        lambda _, value: work.trajectory(scenario.samples, OBSERVED, value),
        FIRST_START_TIME,
        work.largest_trajectory(scenario),
    )
    (outcome,) = run_isolated(job)
    if isinstance(outcome, Died):
        raise Crash(account(outcome, scenario), "killed" if outcome.outside else "")
    if not isinstance(outcome, Done):
        raise error_of(outcome.error)
    found: Trajectory = outcome.value
    return found


def judging(protocol: Protocol, group: Sequence[Case], bench: Bench) -> Job:
    """The job that simulates and judges a ``group`` of cases; its values are judgements."""
    return bench.job(
        work.judge_case.__name__,
        [work.CaseTask(protocol, bench.setup, case) for case in group],
        [case.scenario for case in group],
        lambda index, value: work.judgement(protocol, group[index], value),
        START_TIME,
    )


def rehearse(case: Case, bench: Bench, probe: bool = True) -> Rehearsal:
    """Simulate the first sample of ``case``, then ``probe`` the controller's timing.

    What is wrong with the input shows here, before anything else runs: raises
    :class:`~orchestrator.errors.BenchmarkError` if the FMUs cannot be connected or initialized or refuse the first
    step. It also leaves the compiled code of both in the cache, before several processes would compile it at once.
    """
    scenario = replace(case.scenario, duration=case.scenario.sample_time)
    start = max(FIRST_START_TIME, 0.5 * bench.timeout)  # a user who raises the limit has a slow controller
    task = work.ScenarioTask(bench.setup, scenario, OBSERVED)
    timing = work.TimingRecord()
    # Two jobs, since a crash of the probe, which takes further instances, is no verdict on the controller.
    for function in (work.first_sample.__name__, work.probe_timing.__name__)[: 1 + probe]:
        for outcome in run_isolated(bench.job(function, [task], [scenario], work.timing, start)):
            if isinstance(outcome, Done):
                timing = outcome.value
            elif function == work.first_sample.__name__:
                if not isinstance(outcome, Died):
                    raise error_of(outcome.error)
                if outcome.place.sample == 0 and not outcome.outside:
                    return Rehearsal(failure=case_run(case, outcome))
    return Rehearsal(timing)


def computing_time(case: Case, bench: Bench) -> ComputingTime | None:
    """The controller's computing time over the beginning of ``case``; None if that fails."""
    limit = max(FIRST_START_TIME, 0.5 * bench.timeout)
    task = work.ScenarioTask(bench.setup, case.scenario)
    job = bench.raw_job(
        f"{work.__name__}:{work.time_steps.__name__}", [task], (limit,), lambda _, value: unpack(value, ComputingTime)
    )
    (outcome,) = run_isolated(job)
    return outcome.value if isinstance(outcome, Done) else None


def case_run(case: Case, outcome: Outcome) -> CaseRun:
    """The run of a case from what its process had to say, or left behind."""
    if isinstance(outcome, Done):
        judgement: Judgement = outcome.value
        kind = _first_line(judgement.message) if judgement.status is Status.ERROR else ""
        return CaseRun(case, named(case, judgement), outcome.wall_time, kind)
    if isinstance(outcome, Died):
        # What somebody else has ended, or kept from ending in time, is no failure of the controller.
        status = Status.LOST if outcome.outside else Status.TIMEOUT if outcome.timeout else Status.CRASHED
        outcome = structs.replace(outcome, place=_plausible(outcome.place, case.scenario))
        time = float(outcome.place.sample * case.scenario.sample_time)
        judgement = Judgement(status=status, time=time, message=account(outcome, case.scenario))
        return CaseRun(case, named(case, judgement), outcome.wall_time, outcome.kind)
    error = outcome.error
    kind = f"{error.call} failed" if error.call else _first_line(error.message)
    # Errors are raised before the first sample; a trajectory tells those that come later.
    judgement = Judgement(status=Status.ERROR, time=0.0, message=error.message)
    return CaseRun(case, named(case, judgement), outcome.wall_time, kind)


def account(death: Died, scenario: Scenario) -> str:
    """How a process died, where its simulation was, and what it had printed."""
    return "\n  ".join((f"{death.message}, {_whereabouts(death.place, scenario)}", *death.output))


def _plausible(place: Place, scenario: Scenario) -> Place:
    """``place`` within the simulation: it lay in memory that the FMUs can write into."""
    return replace(place, sample=min(max(place.sample, 0), scenario.samples))


def _whereabouts(place: Place, scenario: Scenario) -> str:
    who = {PLANT: "the plant", CONTROLLER: "the controller"}.get(place.side)
    if who is None:
        return "outside any FMI call"
    return f"in the call '{place.call}' of {who} at t = {float(place.sample * scenario.sample_time):g} s"


def _first_line(message: str) -> str:
    return message.split("\n")[0]


def _reason(strikes: Counter[tuple[Status, str]], at_once: CaseRun | None, keep_going: bool) -> str:
    """Why no more cases are run; empty while they are."""
    if keep_going:
        return ""
    if at_once is not None:
        return f"skipped after a failure in the first sample ({at_once.result.status.value}: {at_once.kind})"
    for (status, kind), count in strikes.items():
        if kind and count >= STRIKES:
            return f"skipped after {count} failures of one kind ({status.value}: {kind})"
    return ""
