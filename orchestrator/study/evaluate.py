"""Running a protocol, once or with several seeds."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

from msgspec.structs import asdict

from ..benchmark.case import Case
from ..benchmark.scorecard import score
from ..documents.evaluation import Evaluation
from ..documents.files import seed_folder
from ..documents.results import Results
from ..documents.spread import Spread, spread_of
from ..errors import InputError
from ..loop.behaviour import MAX_STEPS
from ..loop.trajectory import Status
from ..pairing.controller import Controller
from ..pairing.records import loop_delay
from ..pairing.runs import CaseRun
from ..pairing.testbed import Testbed
from .declaration import Study, described, option
from .heads import head
from .requests import (
    STRIKES,
    Batch,
    BatchEntry,
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
from .selection import shown


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
