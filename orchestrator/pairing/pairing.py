"""A plant and a controller, simulated together in processes of their own."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

from ..benchmark.case import Case
from ..benchmark.doubt import with_latest_end
from ..benchmark.protocol import Protocol
from ..codec import Struct, pack
from ..documents.recording import OBSERVED
from ..errors import Crash
from ..execution.job import Died, Done, Job, Limits, is_once
from ..execution.messages import error_of
from ..execution.standstill import Standstill
from ..execution.supervision import run_isolated
from ..fmi.archive import Archive
from ..loop.scenario import Scenario
from ..loop.setup import Setup
from ..loop.trajectory import Trajectory
from . import work
from .runs import account, tell_standstill

GROUP_SIZE = 9
"""Cases a worker runs before it is replaced: enough that its start does not count, few enough that leaks of FMPy and
of FMUs do not either. A check repeats a case as often, and as many are recorded by one process."""

FULL_LENGTH = 26.0
"""Simulated time [s] that a time limit is given for; shorter simulations get their share."""

START_TIME = 5.0
"""Seconds for instantiation and initialization, on top of the share."""

FIRST_START_TIME = 60.0
"""The same where compiled code may be missing from the cache, at the least."""


@dataclass(frozen=True)
class Pairing:
    """The two FMUs, and the limits they run under.

    ``timeout`` is the processor time [s] that a simulation of FULL_LENGTH may take. If ``isolated``, the process of
    plant and judge never loads the controller. If ``separate``, each task has a process of its own, as where an FMU
    declares that a process can instantiate it only once.
    """

    plant: Archive
    controller: Archive
    setup: Setup = field(default_factory=Setup)
    timeout: float = 60.0
    limits: Limits = field(default_factory=Limits)
    sandbox: bool = False
    isolated: bool = False
    separate: bool = False

    def job(
        self,
        function: str,
        tasks: Sequence[Struct],
        scenarios: Sequence[Scenario],
        decode: Callable[[int, bytes], object],
        start: float,
        largest: int = 1 << 16,
    ) -> Job:
        """A job of this pairing: ``function`` of :mod:`.work` with one scenario per task for the time limits, on top of
        ``start`` [s]."""
        limits = tuple(start + self.timeout * float(scenario.duration) / FULL_LENGTH for scenario in scenarios)
        job = self.raw_job(f"{work.__name__}:{function}", tasks, limits, decode, largest)

        def tell(index: int, standstill: Standstill) -> None:
            task = tasks[index]
            name = task.case.id if isinstance(task, work.CaseTask | work.RecordTask) else "A simulation"
            tell_standstill(standstill, name, scenarios[index])

        # A case that may go on until 60 s in doubt has a longer limit, for its many samples: not for one that hangs.
        return replace(job, longest_call=start + self.timeout, on_standstill=tell)

    def raw_job(
        self,
        function: str,
        tasks: Sequence[Struct],
        time_limits: tuple[float, ...],
        decode: Callable[[int, bytes], object],
        largest: int = 1 << 16,
    ) -> Job:
        """A job of this pairing with any function ("module:name") and time limits [s]."""
        packed = tuple(map(pack, tasks))
        limits = (self.limits, self.sandbox, self.isolated)
        return Job(
            self.plant,
            self.controller,
            function,
            packed,
            time_limits,
            decode,
            largest,
            *limits,
            separate=self.separate,
            # One fork server for all of these jobs, whatever function they run: it has loaded Numba once.
            prepared_by=work.__name__,
            on_standstill=lambda index, standstill: tell_standstill(standstill, "The controller's process"),
        )

    @property
    def is_separate(self) -> bool:
        """Whether each task has a process of its own."""
        return self.separate or is_once(self.plant, self.controller, self.isolated)

    @property
    def restrictions(self) -> str:
        """What a failure may depend on beside its key: limits, and whether there is a sandbox."""
        return json.dumps([self.timeout, self.limits.memory, self.limits.output, self.sandbox, self.isolated])


def simulate(pairing: Pairing, scenario: Scenario) -> Trajectory:
    """The trajectory of ``scenario``, simulated in a process of its own.

    Raises :class:`FmuError` if an FMU fails before the first sample, :class:`Crash` if the process ends before the
    simulation.
    """
    job = pairing.job(
        work.simulate_scenario.__name__,
        [work.ScenarioTask(pairing.setup, scenario, OBSERVED)],
        [scenario],
        lambda _, value: work.trajectory(scenario.samples, OBSERVED, value),
        FIRST_START_TIME,
        work.largest_trajectory(scenario),
    )
    trajectory: Trajectory = only(job, scenario)
    return trajectory


def simulate_case(pairing: Pairing, protocol: Protocol, case: Case) -> work.Simulated:
    """``case`` simulated and judged.

    Raises what :func:`simulate` does.
    """
    simulated: work.Simulated = only(record_job(protocol, [case], pairing, FIRST_START_TIME), case.scenario)
    return simulated


def only(job: Job, scenario: Scenario) -> Any:
    """The value of the only task of ``job``, which simulates ``scenario``.

    Raises what :func:`simulate` does.
    """
    (outcome,) = run_isolated(job)
    if isinstance(outcome, Died):
        raise Crash(account(outcome, scenario), "killed" if outcome.outside else "")
    if not isinstance(outcome, Done):
        raise error_of(outcome.error)
    return outcome.value


def judge_job(protocol: Protocol, group: Sequence[Case], pairing: Pairing) -> Job:
    """The job that simulates and judges a ``group`` of cases; its values are judgements."""
    return pairing.job(
        work.judge_case.__name__,
        [work.CaseTask(protocol, pairing.setup, case) for case in group],
        [with_latest_end(protocol, case) for case in group],
        lambda index, value: work.judged(protocol, group[index], value),
        START_TIME,
    )


def digest_job(protocol: Protocol, group: Sequence[Case], pairing: Pairing) -> Job:
    """The same with digests of the signals: the values are :class:`.work.Digested`."""
    job = judge_job(protocol, group, pairing)
    return replace(
        job,
        work=f"{work.__name__}:{work.digest_case.__name__}",
        decode=lambda index, value: work.digested(protocol, group[index], value),
    )


def beginning_job(protocol: Protocol, group: Sequence[Case], pairing: Pairing) -> Job:
    """The same with digests of the cases' beginnings; behind the others, the beginning of the first one is repeated,
    which gives its digest alone."""
    first = work.beginning(group[0].scenario)
    return pairing.job(
        work.begin_case.__name__,
        [
            *(work.CaseTask(protocol, pairing.setup, case) for case in group),
            work.ScenarioTask(pairing.setup, first),
        ],
        [*(with_latest_end(protocol, case) for case in group), first],
        lambda index, value: work.digested(protocol, group[index], value) if index < len(group) else work.begun(value),
        START_TIME,
    )


def record_job(protocol: Protocol, group: Sequence[Case], pairing: Pairing, start: float = START_TIME) -> Job:
    """The same with trajectories: the values are :class:`.work.Simulated`."""
    scenarios = [with_latest_end(protocol, case) for case in group]
    return pairing.job(
        work.simulate_case.__name__,
        [work.CaseTask(protocol, pairing.setup, case) for case in group],
        scenarios,
        lambda index, value: work.simulated(protocol, group[index], value),
        start,
        max(map(work.largest_trajectory, scenarios)),
    )
