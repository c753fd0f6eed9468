"""Running a protocol, once or with several seeds."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TypedDict

from msgspec.structs import asdict

from ..benchmark.case import Case
from ..benchmark.scorecard import score
from ..documents.evaluation import Evaluation
from ..documents.files import seed_folder
from ..documents.results import Results
from ..documents.spread import Spread, spread_of
from ..errors import InputError
from ..loop.computing import MANY
from ..loop.trajectory import Status
from ..pairing.controller import Controller
from ..pairing.records import loop_delay
from ..pairing.runs import CaseRun
from ..pairing.testbed import Testbed
from .heads import head
from .requests import STRIKES, Batch, Entry, Now, Record, Rehearse, Save, SeedDone, Study, Tell, TimeSteps
from .selection import shown


class Options(TypedDict, total=False):
    """Options of an evaluation that hold for every seed."""

    only: Sequence[str] | str
    recordings: bool
    keep_going: bool
    force: bool


def evaluate(
    testbed: Testbed,
    controller: Controller,
    *,
    only: Sequence[str] | str = (),
    recordings: bool = True,
    keep_going: bool = False,
    force: bool = False,
    inside: str = "",
) -> Study[Evaluation]:
    """See :meth:`.Benchmark.evaluate`; it is saved in the folder ``inside`` the study's."""
    controller, pairing, sample_time, all_cases = testbed.prepared(controller)
    cases, protocol = _chosen(all_cases, only), testbed.rules
    begin = yield Now()
    rehearsal = yield Rehearse(pairing, cases[0])
    patience = None if keep_going else STRIKES
    (runs,) = yield Batch((Entry(protocol, pairing, cases, patience, force, rehearsal.failure),))
    # Afterwards, since a controller that hangs early would take a time limit more.
    is_timed = rehearsal.failure is None and not any(_hangs_early(run, sample_time) for run in runs)
    computing_time = (yield TimeSteps(pairing, cases[0])) if is_timed else None
    end = yield Now()
    found = head(testbed, controller, pairing, sample_time, begin, end, computing_time=computing_time)
    listed = tuple(run.result for run in runs)
    results = Results(
        schema=Results.SCHEMA,
        head=found,
        **asdict(score(found.rules, listed)),
        cases=listed,
        loop_delay=loop_delay(protocol, sample_time, rehearsal.timing),
    )
    evaluation = Evaluation(results)
    yield Save(evaluation, inside)  # before the recordings: whatever happens now, the results are there
    if recordings:
        wanted = shown(protocol, testbed.nominal, testbed.seed, runs, results.scorecard)
        evaluation = Evaluation(results, (yield Record(pairing, tuple(wanted))))
        yield Save(evaluation, inside)
    return evaluation


def spread(
    testbed: Testbed,
    controller: Controller,
    seeds: Iterable[int],
    *,
    only: Sequence[str] | str = (),
    recordings: bool = True,
    keep_going: bool = False,
    force: bool = False,
    inside: str = "",
) -> Study[Spread]:
    """See :meth:`.Benchmark.spread`; each seed is evaluated in a folder of its own."""
    wanted = tuple(dict.fromkeys(seeds))
    if not wanted:
        raise InputError("At least one seed is needed.", "bad-number")
    found, begin = [], (yield Now())
    controller, pairing, sample_time, _ = testbed.prepared(controller)
    for seed in wanted:
        own = f"{inside}/{seed_folder(seed)}" if inside else seed_folder(seed)
        evaluation = yield from evaluate(
            replace(testbed, seed=seed),
            controller,
            only=only,
            recordings=recordings,
            keep_going=keep_going,
            force=force,
            inside=own,
        )
        found.append(evaluation.results)
        end = yield Now()
        own_head = head(testbed, controller, pairing, sample_time, begin, end, several_seeds=True)
        result = spread_of(wanted, found, own_head)
        yield Save(result, inside)
        yield Tell(SeedDone(seed, evaluation))
    return result


def _hangs_early(run: CaseRun, sample_time: Fraction) -> bool:
    """Whether a case did not get beyond the steps whose computing time is measured."""
    return run.result.status is Status.TIMEOUT and run.result.time < MANY * sample_time


def _chosen(cases: Sequence[Case], only: Sequence[str] | str) -> tuple[Case, ...]:
    patterns = [only] if isinstance(only, str) else only
    if not patterns:
        return tuple(cases)
    chosen = tuple(case for case in cases if any(fnmatch.fnmatchcase(case.id, pattern) for pattern in patterns))
    if not chosen:
        wanted = " ".join(patterns)
        raise InputError(
            f"No case matches {wanted}. Cases are named like {cases[0].id} and {cases[-1].id}.", "no-case", "", wanted
        )
    return chosen
