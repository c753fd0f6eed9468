"""What a controller shows before its cases run: its first sample, whether it carries state over, its timing, its
computing time."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any

import numpy as np

from ..benchmark.case import Case
from ..codec import unpack
from ..documents.recording import OBSERVED
from ..errors import Crash, FmuError
from ..execution.job import Died, Done, Outcome
from ..execution.messages import error_of
from ..execution.supervision import run_isolated
from ..loop import behaviour
from ..loop.behaviour import CarryOver, ComputingTime, carry_over
from ..loop.scenario import Pulse, Scenario
from ..pairing import pairing as pairings
from ..pairing import work
from ..pairing.pairing import Pairing, only
from ..pairing.runs import CaseRun, case_run

REPEATED_DURATION = Fraction(1)
"""Simulated time [s] of the simulation that is repeated: an evaluation simulates hundreds of times as much."""

PUSHING_FORCE = Pulse((200.0, 200.0), 0.1, 0.4)
"""The force that acts meanwhile: a law at rest would show little of its state."""

VISITED_DURATION = Fraction(2)
"""Simulated time [s] of further simulations before the one that is repeated, but for the first, which is whole."""

POSE_OFFSET = 0.1
"""How far [rad] the link angles of the simulation before lie from those of the one that is repeated."""


@dataclass(frozen=True)
class Rehearsal:
    """What the first sample has shown: the controller's ``timing``, the run of the case if its process has not come
    through the first sample, so that no case can be expected to, and whether state is carried over."""

    timing: work.TimingRecord = field(default_factory=work.TimingRecord)
    failure: CaseRun | None = None
    carry_over: CarryOver = CarryOver.NOT_TESTED


def rehearse(
    case: Case, pairing: Pairing, probe: bool = True, compare: bool = True, visited: Sequence[Case] = ()
) -> Rehearsal:
    """Simulate the first sample of ``case``, then ``compare`` a simulation after others with the same in a fresh
    process, and ``probe`` the controller's timing. The others are one at another pose, the first case ``visited``,
    and the beginnings of the other cases ``visited``.

    What is wrong with the input shows here, before anything else runs: raises
    :class:`~orchestrator.errors.BenchmarkError` if the FMUs cannot be connected or initialized or refuse the first
    step. It also leaves the compiled code of both in the cache, before several processes would compile it at once.
    """
    T_s, begin = case.scenario.sample_time, _beginning(case.scenario)
    repeated = [begin] if compare and not pairing.is_separate and not pairing.isolated else []
    visits = [each.scenario if place == 0 else _visit(each.scenario) for place, each in enumerate(visited)]
    before = [*map(_elsewhere, repeated), *visits]
    scenarios = [replace(case.scenario, duration=T_s), *(before if repeated else ()), *repeated]
    begun: list[work.Beginning] = []
    for outcome in _run(pairing, _simulations(pairing, scenarios)):
        if isinstance(outcome, Done):
            begun.append(outcome.value)
        elif outcome.index == 0:
            if not isinstance(outcome, Died):
                raise error_of(outcome.error)
            # A process that dies in its first sample does so in each case: hundreds of time limits are spared.
            if outcome.place.sample == 0 and not outcome.outside:
                return Rehearsal(failure=case_run(case, outcome))
    declared = pairing.controller.once_per_process and not pairing.isolated
    shown = CarryOver.DECLARED if declared else CarryOver.NOT_TESTED
    if not begun:
        return Rehearsal(carry_over=shown)
    experiments = _experiments(pairing, begun[0], T_s) if probe else []
    fresh = _simulations(pairing, repeated) if len(begun) == len(scenarios) else []
    # In one process: to start one takes as long as to simulate half a case.
    values = [outcome.value for outcome in _run(pairing, [*fresh, *experiments]) if isinstance(outcome, Done)]
    if fresh and values:
        shown = carry_over(begun[-1].digest, values.pop(0).digest, lambda: _digest(pairing, fresh))
        if shown.separates:
            outcomes = _run(replace(pairing, separate=True), experiments)
            values = [outcome.value for outcome in outcomes if isinstance(outcome, Done)]
    if not probe or len(values) < len(experiments):  # what cannot be probed may still be simulated
        return Rehearsal(carry_over=shown)
    measured = behaviour.timing(values)
    return Rehearsal(work.TimingRecord(measured.latency, measured.convention.value), None, shown)


def _simulations(pairing: Pairing, scenarios: Sequence[Scenario]) -> list[work.ScenarioTask]:
    return [work.ScenarioTask(pairing.setup, scenario, OBSERVED) for scenario in scenarios]


def _experiments(pairing: Pairing, rest: work.Beginning, T_s: Fraction) -> list[work.AnswerTask]:
    """What shows the timing of a controller at ``rest``."""
    return [
        work.AnswerTask(pairing.setup, rest.q_m, rest.u_m, rest.q_a, T_s, behaviour.step_errors(begin), initially)
        for begin, initially in behaviour.EXPERIMENTS
    ]


def _beginning(scenario: Scenario) -> Scenario:
    """The beginning of ``scenario``, in which the arm is pushed."""
    return replace(scenario, duration=min(scenario.duration, REPEATED_DURATION), pulse=PUSHING_FORCE)


def _visit(scenario: Scenario) -> Scenario:
    return replace(scenario, duration=min(scenario.duration, VISITED_DURATION))


def _elsewhere(scenario: Scenario) -> Scenario:
    moved = (
        (name, value + POSE_OFFSET if name.startswith("q_a_start") else value) for name, value in scenario.parameters
    )
    return replace(scenario, parameters=tuple(moved))


def _digest(pairing: Pairing, fresh: Sequence[work.ScenarioTask]) -> bytes | None:
    """That of the first simulation in a new process; None if it fails."""
    for outcome in _run(pairing, fresh):
        if isinstance(outcome, Done):
            digest: bytes = outcome.value.digest
            return digest
    return None


def _run(pairing: Pairing, tasks: Sequence[work.ScenarioTask | work.AnswerTask]) -> Iterator[Outcome]:
    """The outcomes of ``tasks`` up to the first one that fails."""

    def decode(index: int, value: bytes) -> Any:
        task = tasks[index]
        if isinstance(task, work.AnswerTask):
            return work.answered(len(task.errors), value)
        return unpack(value, work.Beginning)

    def limit(task: work.ScenarioTask | work.AnswerTask) -> float:
        first = isinstance(task, work.AnswerTask) or task.scenario.samples == 1
        start = _first_limit(pairing) if first else pairings.START_TIME
        duration = 0 if isinstance(task, work.AnswerTask) else task.scenario.duration
        return start + pairing.timeout * float(duration) / pairings.FULL_LENGTH

    job = pairing.raw_job(f"{work.__name__}:{work.rehearse.__name__}", tasks, tuple(map(limit, tasks)), decode)
    return run_isolated(replace(job, give_up=True))


def _first_limit(pairing: Pairing) -> float:
    """Time limit [s] where compiled code may be missing. A user who raises the limit has a slow controller; one who
    lowers it does not want to wait for a minute where a start or an end hangs."""
    shortest = max(pairings.START_TIME, 2.0 * pairing.timeout)
    return max(min(pairings.FIRST_START_TIME, shortest), 0.5 * pairing.timeout)


def computing_time(case: Case, pairing: Pairing) -> ComputingTime | None:
    """The controller's computing time over the beginning of ``case``; None if that fails."""
    scenario, limit = case.scenario, (_first_limit(pairing),)
    function = f"{work.__name__}:"

    def times(steps: int) -> np.ndarray:
        """As in :func:`~orchestrator.loop.probe.computing_time`, but each instance in a process of its own."""
        short = replace(scenario, duration=min(scenario.duration, steps * scenario.sample_time))
        task = work.ScenarioTask(pairing.setup, short, OBSERVED)
        loop = only(
            pairing.raw_job(
                function + work.simulate_scenario.__name__,
                [task],
                limit,
                lambda _, value: work.trajectory(short.samples, OBSERVED, value),
                work.largest_trajectory(short),
            ),
            short,
        )
        errors = np.array(loop.q_m_ref) - loop.measured[:steps]
        q_a = float(loop.extra["q_a[1]"][0]), float(loop.extra["q_a[2]"][0])
        stepped = work.AnswerTask(pairing.setup, loop.q_m_ref, loop.u_m0, q_a, scenario.sample_time, errors)
        decode = lambda _, value: work.times(len(errors), value)  # noqa: E731
        step_times: np.ndarray = only(
            pairing.raw_job(function + work.time_answers.__name__, [stepped], limit, decode), short
        )
        return step_times

    try:
        if pairing.is_separate:
            return behaviour.computing_time(times)
        task = work.ScenarioTask(pairing.setup, scenario)
        decode = lambda _, value: unpack(value, ComputingTime)  # noqa: E731
        measured: ComputingTime = only(
            pairing.raw_job(function + work.time_steps.__name__, [task], limit, decode), scenario
        )
        return measured
    except (FmuError, Crash):
        return None
