"""A grid of parameter values, every combination tried in the same cases."""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Mapping, Sequence
from pathlib import Path

from ..benchmark.results import rules
from ..errors import Crash, InputError
from ..execution import store
from ..reporting.files import prepare_folder
from ..reporting.sweep import Sweep
from ..search.candidates import Trial
from ..search.proposals import GENERATION
from . import campaign, document
from .conditions import Conditions
from .controller import Controller
from .side_by_side import SideBySide
from .tuner import OnTrial, attempt
from .tuning import values_of


def sweep(
    bench: Conditions,
    controller: Controller,
    given: Mapping[str, Sequence[float]],
    folder: Path | None,
    on_trial: OnTrial | None,
) -> Sweep:
    """See :meth:`.Benchmark.sweep`."""
    begin = time.perf_counter()
    values = {name: tuple(map(float, each)) for name, each in given.items()}
    if not values or not all(values.values()):
        raise InputError("Nothing varies: at least one parameter with its values is needed.", "nothing-varies")
    if bad := [name for name, each in values.items() if not all(map(math.isfinite, each))]:
        raise InputError(f"The values of {bad[0]} are not finite.", "bad-number", bad[0])
    controller, conditions, _, cases = bench.prepared(controller)
    values_of(controller, values)
    if folder is not None:
        prepare_folder(folder)
    grid = [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]
    trials: list[Trial] = []
    with store.opened(folder) as known:
        if (failure := campaign.rehearse(cases[0], conditions).failure) is not None:
            raise Crash(failure.result.message)
        side_by_side, own = SideBySide(bench.rules, bench.execute, known), rules(bench.rules)
        while asked := list(enumerate(grid))[len(trials) : len(trials) + GENERATION]:
            for each in attempt(side_by_side, own, lambda v: bench.bench(controller.with_parameters(v)), cases, asked):
                trials.append(each)
                if on_trial is not None:
                    on_trial(each, len(trials), len(grid))
    found = Sweep(
        schema=Sweep.SCHEMA,
        benchmark=bench.rules.benchmark,
        protocol=bench.rules.name,
        seed=bench.seed,
        values=values,
        trials=tuple(trials),
        rules=own,
        controller=document.controller_record(conditions, controller),
        plant=document.plant_record(bench.manipulator, bench.plant_parameters),
        wall_time=time.perf_counter() - begin,
    )
    if folder is not None:
        found.save(folder)
    return found
