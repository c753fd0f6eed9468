"""Running a protocol, once or with several seeds."""

from __future__ import annotations

import fnmatch
from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import TypedDict

from ..benchmark.case import Case
from ..benchmark.results import RunTiming
from ..errors import InputError
from ..pairing import records
from ..pairing.conditions import Conditions
from ..pairing.controller import Controller
from ..reporting.evaluation import Evaluation
from ..reporting.files import seed_folder
from ..reporting.spread import Spread, spread_of
from .requests import STRIKES, Batch, Entry, Now, Record, Rehearse, Save, SeedDone, Study, Tell, TimeSteps
from .selection import shown


class Options(TypedDict, total=False):
    """Options of an evaluation that hold for every seed."""

    only: Sequence[str] | str
    recordings: bool
    keep_going: bool
    force: bool


def evaluate(
    conditions: Conditions,
    controller: Controller | None,
    *,
    only: Sequence[str] | str = (),
    recordings: bool = True,
    keep_going: bool = False,
    force: bool = False,
    inside: str = "",
) -> Study[Evaluation]:
    """See :meth:`.Benchmark.evaluate`; it is saved in the folder ``inside`` the study's."""
    controller, pairing, sample_time, all_cases = conditions.prepared(controller)
    cases, protocol = _chosen(all_cases, only), conditions.rules
    begin = yield Now()
    rehearsal = yield Rehearse(pairing, cases[0])
    computing_time = None if rehearsal.failure else (yield TimeSteps(pairing, cases[0]))
    patience = None if keep_going else STRIKES
    (runs,) = yield Batch((Entry(protocol, pairing, cases, patience, force, rehearsal.failure),))
    end = yield Now()
    timing = RunTiming(
        begin.start,
        end.seconds - begin.seconds,
        begin.processes,
        sum(run.result.time for run in runs),
        sum(run.wall_time for run in runs),
        computing_time,
    )
    results = records.results(
        protocol,
        str(conditions.protocol) if str(conditions.protocol) != protocol.name else "",
        conditions.seed,
        pairing,
        controller,
        records.plant_record(conditions.manipulator, conditions.plant_parameters),
        sample_time,
        rehearsal.timing,
        [run.result for run in runs],
        timing,
    )
    evaluation = Evaluation(results)
    yield Save(evaluation, inside)  # before the recordings: whatever happens now, the results are there
    if recordings:
        wanted = shown(protocol, conditions.nominal, conditions.seed, runs, results.scorecard)
        evaluation = Evaluation(results, (yield Record(pairing, tuple(wanted))))
        yield Save(evaluation, inside)
    return evaluation


def spread(
    conditions: Conditions,
    controller: Controller | None,
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
    found = []
    for seed in wanted:
        own = f"{inside}/{seed_folder(seed)}" if inside else seed_folder(seed)
        evaluation = yield from evaluate(
            replace(conditions, seed=seed),
            controller,
            only=only,
            recordings=recordings,
            keep_going=keep_going,
            force=force,
            inside=own,
        )
        found.append(evaluation.results)
        result = spread_of(wanted, found)
        yield Save(result, inside)
        yield Tell(SeedDone(seed, evaluation))
    return result


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
