"""Running a protocol, once or with several seeds; and which of its cases the report shows in full: the worst ones, an
example, and many systems in one pose."""

from __future__ import annotations

import fnmatch
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from msgspec.structs import asdict

from ..benchmark import cases
from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import Scorecard
from ..benchmark.scorecard import score
from ..documents.evaluation import Evaluation
from ..documents.files import seed_folder
from ..documents.recording import EXAMPLE, SYSTEMS
from ..documents.results import Results
from ..documents.spread import Spread, spread_of
from ..errors import InputError
from ..exact_time import seconds
from ..loop.behaviour import MAX_STEPS
from ..loop.trajectory import Status
from ..pairing.controller import Controller
from ..pairing.runs import CaseRun
from ..pairing.testbed import Testbed
from .declaration import Study, described, option
from .heads import head, loop_delay
from .requests import (
    STRIKES,
    Batch,
    BatchEntry,
    CaseToShow,
    Now,
    Record,
    Rehearse,
    Requests,
    Save,
    SeedDone,
    Tell,
    TimeSteps,
    inside,
)


@described
@dataclass(frozen=True)
class EvaluationStudy(Study[Evaluation]):
    """A protocol, run once."""

    command = "evaluate"

    only: Sequence[str] | str = option((), "only cases whose name matches, with * and ?", metavar="PATTERN")
    recordings: bool = option(
        True, "whether the cases that a report shows are simulated once more and recorded", asked=False
    )
    keep_going: bool = option(
        False,
        "do not give up after three failures of one kind, or two timeouts, and run again what failed before",
    )
    force: bool = option(False, "run again what an earlier run has finished")

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Evaluation]:
        """The requests of an evaluation: cases, and recordings of those that a report shows."""
        controller, pairing, sample_time, all_cases = testbed.prepared(controller)
        cases, protocol = _chosen(all_cases, self.only), testbed.rules
        begin = yield Now()
        rehearsal = yield Rehearse(pairing, cases[0])
        patience = None if self.keep_going else STRIKES
        (runs,) = yield Batch((BatchEntry(protocol, pairing, cases, patience, self.force, rehearsal.failure),))
        # Afterwards, since a controller that hangs early would take a time limit more.
        is_timed = rehearsal.failure is None and not any(_hangs_early(run, sample_time) for run in runs)
        computing_time = (yield TimeSteps(pairing, cases[0])) if is_timed else None
        end = yield Now()
        document_head = head(testbed, controller, pairing, sample_time, begin, end, computing_time=computing_time)
        listed = tuple(run.result for run in runs)
        results = Results(
            schema=Results.SCHEMA,
            head=document_head,
            **asdict(score(document_head.rules, listed)),
            cases=listed,
            loop_delay=loop_delay(protocol, sample_time, rehearsal.timing),
        )
        evaluation = Evaluation(results)
        yield Save(evaluation)  # before the recordings: whatever happens now, the results are there
        if self.recordings:
            cases_to_show = shown(protocol, testbed.nominal, testbed.seed, runs, results.scorecard)
            evaluation = Evaluation(results, (yield Record(pairing, tuple(cases_to_show))))
            yield Save(evaluation)
        return evaluation


@described
@dataclass(frozen=True)
class SpreadStudy(Study[Spread]):
    """A protocol, run once with each of several seeds: mean and standard deviation of V and of each criterion, and for
    how many seeds each requirement holds."""

    command = "evaluate"
    suffix = "-seeds"

    seeds: Iterable[int] = option(
        lambda: range(10), "evaluate with each of these, such as 0-9 or 0,3,5-7: mean and standard deviation"
    )
    evaluation: EvaluationStudy = option(
        EvaluationStudy, "what is done with each seed, in a folder of its own", asked=False
    )

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Spread]:
        """The requests of an evaluation for each seed."""
        seeds = tuple(dict.fromkeys(self.seeds))
        if not seeds:
            raise InputError("At least one seed is needed.", "bad-number")
        results, begin = [], (yield Now())
        controller, pairing, sample_time, _ = testbed.prepared(controller)
        for seed in seeds:
            asked = self.evaluation.ask(replace(testbed, seed=seed), controller)
            evaluation = yield from inside(seed_folder(seed), asked)
            results.append(evaluation.results)
            end = yield Now()
            own_head = head(testbed, controller, pairing, sample_time, begin, end, several_seeds=True)
            result = spread_of(seeds, results, own_head)
            yield Save(result)
            yield Tell(SeedDone(seed, evaluation))
        return result


def _hangs_early(run: CaseRun, sample_time: Fraction) -> bool:
    """Whether a case did not get beyond the steps whose computing time is measured."""
    return run.result.status is Status.TIMEOUT and run.result.time < MAX_STEPS * sample_time


def _chosen(cases: Sequence[Case], only: Sequence[str] | str) -> tuple[Case, ...]:
    patterns = [only] if isinstance(only, str) else only
    if not patterns:
        return tuple(cases)
    chosen = tuple(case for case in cases if any(fnmatch.fnmatchcase(case.id, pattern) for pattern in patterns))
    if not chosen:
        asked = " ".join(patterns)
        raise InputError(
            f"No case matches {asked}. Cases are named like {cases[0].id} and {cases[-1].id}.", "no-case", "", asked
        )
    return chosen


POSE = (math.radians(18.0), math.radians(-50.0))
"""Link angles [rad] of the example and the spread: an ordinary pose in the middle of the workspace."""

SPREAD_SYSTEMS = 20
"""Uncertain systems in Figures 11 and 12 of the paper."""

TIME_AFTER_FORCE = 4.0
"""Seconds shown of the spread after the force has ended: the wanted settling time, and a second of what follows."""


def shown(
    protocol: Protocol, nominal: Mapping[str, float], seed: int, runs: Sequence[CaseRun], card: Scorecard
) -> list[CaseToShow]:
    """What to simulate for the report of ``runs``.

    A case that hung or ended its process would do so again, and one that was lost may: it is not tried. Where one hung,
    or none came to its end, nothing is tried that was not tried before. The spread is limited to as many systems as the
    evaluation ran, so that a short evaluation stays short.
    """
    by_id = {run.case.id: run for run in runs}
    chosen = [
        CaseToShow(by_id[id].case, tuple(roles))
        for id, roles in _worst(card).items()
        if by_id[id].result.status not in (Status.TIMEOUT, Status.CRASHED, Status.LOST, Status.SKIPPED)
    ]
    statuses = {run.result.status for run in runs}
    # Each recording of a controller that hangs would cost a time limit.
    if Status.DONE not in statuses or Status.TIMEOUT in statuses:
        return chosen
    test = next((test for test in protocol.tests if "B5" in test.criteria), None)
    if test is None:  # a protocol of one's own, without a force whose course could be compared
        return chosen
    size = min(SPREAD_SYSTEMS, sum(run.case.test == test for run in runs))
    sample_time = runs[0].case.scenario.sample_time

    def in_pose(name: str, role: str, duration: float | None = None) -> CaseToShow:
        pose = cases.configuration(protocol, *POSE, seed)
        system = cases.system(protocol, nominal, seed, pose.index, name, test)
        case = cases.case(protocol, pose, system, test, seed)
        scenario = replace(case.scenario, sample_time=sample_time)
        if duration is not None:
            scenario = replace(scenario, duration=min(scenario.duration, seconds(duration)))
        return CaseToShow(replace(case, scenario=scenario), (role,))

    end = protocol.disturbance.t_2 + TIME_AFTER_FORCE
    names = [*protocol.sets[test.systems], *(f"random_{number}" for number in range(1, SPREAD_SYSTEMS))]
    spread = [in_pose(name, SYSTEMS, end) for name in list(dict.fromkeys(names))[:size]]
    return [*chosen, in_pose("nominal", EXAMPLE), *spread]


def _worst(card: Scorecard) -> dict[str, list[str]]:
    """Cases to show with what for: worst of a criterion, and of a requirement that fails, on each axis if it has
    axes."""
    roles: dict[str, list[str]] = {}
    for name, criterion in card.criteria.items():
        if criterion.worst_case:
            roles.setdefault(criterion.worst_case.id, []).append(name)
    for name, requirement in card.stability.items():
        for role, verdict in requirement.by_role(name):
            if verdict.worst_case and verdict.passed is False:
                roles.setdefault(verdict.worst_case, []).append(role)
    return roles
