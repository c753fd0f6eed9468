"""Running a protocol, once or with several seeds."""

from __future__ import annotations

import fnmatch
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from datetime import datetime, timezone
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

from ..benchmark.case import Case
from ..benchmark.results import CaseResult, RunTiming
from ..errors import InputError
from ..reporting.files import seed_folder
from ..reporting.spread import Spread, spread_of
from . import campaign, document
from .conditions import Conditions
from .controller import Controller
from .evaluation import Evaluation
from .recorder import record_shown
from .selection import shown

if TYPE_CHECKING:
    from typing_extensions import Unpack

OnResult = Callable[[CaseResult, int, int], None]
"""Is told each result as it comes, how many there are, and how many there will be."""

OnSeed = Callable[[int, Evaluation], None]
"""Is told each seed with its evaluation."""


class Options(TypedDict, total=False):
    """Options of :func:`evaluate` that hold for every seed."""

    only: Sequence[str] | str
    recordings: bool
    keep_going: bool
    force: bool
    on_result: OnResult | None


def evaluate(
    conditions: Conditions,
    controller: Controller | None,
    *,
    only: Sequence[str] | str = (),
    folder: str | Path | None = None,
    recordings: bool = True,
    keep_going: bool = False,
    force: bool = False,
    on_result: OnResult | None = None,
) -> Evaluation:
    """See :meth:`.Benchmark.evaluate`."""
    controller, bench, sample_time, cases = conditions.prepared(controller)
    cases, target = _chosen(cases, only), None if folder is None else Path(folder)
    start, begin = datetime.now(timezone.utc), time.perf_counter()
    with conditions.runner(bench, target, keep_going) as runner:
        rehearsal = campaign.rehearse(cases[0], bench)
        computing_time = None if rehearsal.failure else campaign.computing_time(cases[0], bench)
        told = None if on_result is None else lambda run, done, total: on_result(run.result, done, total)
        runs = runner.run(cases, rehearsal.failure, force, told)
        timing = RunTiming(
            start.isoformat(timespec="seconds"),
            time.perf_counter() - begin,
            conditions.processes,
            sum(run.result.time for run in runs),
            sum(run.wall_time for run in runs),
            computing_time,
        )
        results = document.results(
            conditions.rules,
            str(conditions.protocol) if str(conditions.protocol) != conditions.rules.name else "",
            conditions.seed,
            bench,
            controller,
            document.plant_record(conditions.manipulator, conditions.plant_parameters),
            sample_time,
            rehearsal.timing,
            runs,
            timing,
        )
        evaluation = Evaluation(results)
        if target is not None:
            evaluation.save(target)  # before the recordings: whatever happens now, the results are there
        if recordings:
            wanted = shown(conditions.rules, conditions.nominal, conditions.seed, runs, results.scorecard)
            evaluation = replace(evaluation, recordings=record_shown(wanted, bench, conditions.processes))
            if target is not None:
                evaluation.save(target)
    return evaluation


def evaluate_seeds(
    conditions: Conditions,
    controller: Controller | None,
    seeds: Iterable[int],
    folder: str | Path | None,
    on_seed: OnSeed | None,
    **options: Unpack[Options],
) -> Spread:
    """See :meth:`.Benchmark.spread`."""
    wanted, found = tuple(dict.fromkeys(seeds)), []
    benches = [replace(conditions, seed=seed) for seed in wanted]
    if not benches:
        raise InputError("At least one seed is needed.", "bad-number")
    for bench in benches:
        own = None if folder is None else Path(folder) / seed_folder(bench.seed)
        evaluation = evaluate(bench, controller, folder=own, **options)
        found.append(evaluation.results)
        spread = spread_of(wanted, found)
        if folder is not None:
            spread.save(folder)
        if on_seed is not None:
            on_seed(bench.seed, evaluation)
    return spread


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
