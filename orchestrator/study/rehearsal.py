"""What a controller shows before its cases run: its first sample, its timing, its computing time."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

from ..benchmark.case import Case
from ..codec import unpack
from ..documents.recording import OBSERVED
from ..execution.job import Died, Done
from ..execution.messages import error_of
from ..execution.supervision import run_isolated
from ..loop.computing import ComputingTime
from ..pairing import pairing, work
from ..pairing.pairing import Pairing
from ..pairing.runs import CaseRun, case_run


@dataclass(frozen=True)
class Rehearsal:
    """What the first sample has shown: the controller's ``timing``, and the run of the case if its process has not come
    through the first sample: no case can then be expected to."""

    timing: work.TimingRecord = field(default_factory=work.TimingRecord)
    failure: CaseRun | None = None


def rehearse(case: Case, own: Pairing, probe: bool = True) -> Rehearsal:
    """Simulate the first sample of ``case``, then ``probe`` the controller's timing.

    What is wrong with the input shows here, before anything else runs: raises
    :class:`~orchestrator.errors.BenchmarkError` if the FMUs cannot be connected or initialized or refuse the first
    step. It also leaves the compiled code of both in the cache, before several processes would compile it at once.
    """
    scenario = replace(case.scenario, duration=case.scenario.sample_time)
    start = max(pairing.FIRST_START_TIME, 0.5 * own.timeout)  # a user who raises the limit has a slow controller
    task = work.ScenarioTask(own.setup, scenario, OBSERVED)
    timing = work.TimingRecord()
    # Two jobs, since a crash of the probe, which takes further instances, is no verdict on the controller.
    for function in (work.first_sample.__name__, work.probe_timing.__name__)[: 1 + probe]:
        for outcome in run_isolated(own.job(function, [task], [scenario], work.timing, start)):
            if isinstance(outcome, Done):
                timing = outcome.value
            elif function == work.first_sample.__name__:
                if not isinstance(outcome, Died):
                    raise error_of(outcome.error)
                if outcome.place.sample == 0 and not outcome.outside:
                    return Rehearsal(failure=case_run(case, outcome))
    return Rehearsal(timing)


def computing_time(case: Case, own: Pairing) -> ComputingTime | None:
    """The controller's computing time over the beginning of ``case``; None if that fails."""
    limit = max(pairing.FIRST_START_TIME, 0.5 * own.timeout)
    task = work.ScenarioTask(own.setup, case.scenario)
    job = own.raw_job(
        f"{work.__name__}:{work.time_steps.__name__}", [task], (limit,), lambda _, value: unpack(value, ComputingTime)
    )
    (outcome,) = run_isolated(job)
    return outcome.value if isinstance(outcome, Done) else None
