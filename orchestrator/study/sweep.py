"""A grid of parameter values, every combination tried in the same cases."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

from ..benchmark.results import rules
from ..errors import InputError
from ..pairing import records
from ..pairing.conditions import Conditions
from ..pairing.controller import Controller
from ..reporting.sweep import Sweep
from ..search.candidates import Trial
from ..search.proposals import GENERATION
from .candidates import attempt, values_of
from .requests import Now, Save, Study, Tell, TrialDone, rehearsed


def sweep(conditions: Conditions, controller: Controller, given: Mapping[str, Sequence[float]]) -> Study[Sweep]:
    """See :meth:`.Benchmark.sweep`."""
    values = {name: tuple(map(float, each)) for name, each in given.items()}
    if not values or not all(values.values()):
        raise InputError("Nothing varies: at least one parameter with its values is needed.", "nothing-varies")
    if bad := [name for name, each in values.items() if not all(map(math.isfinite, each))]:
        raise InputError(f"The values of {bad[0]} are not finite.", "bad-number", bad[0])
    controller, pairing, _, cases = conditions.prepared(controller)
    values_of(controller, values)
    own = rules(conditions.rules)
    begin = yield Now()
    yield from rehearsed(pairing, cases[0])
    grid = [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]
    trials: list[Trial] = []
    while asked := list(enumerate(grid))[len(trials) : len(trials) + GENERATION]:
        benches = [conditions.pairing(controller.with_parameters(chosen)) for _, chosen in asked]
        for each in (yield from attempt(conditions.rules, own, benches, cases, asked)):
            trials.append(each)
            yield Tell(TrialDone(each, len(trials), len(grid)))
    end = yield Now()
    found = Sweep(
        schema=Sweep.SCHEMA,
        benchmark=conditions.rules.benchmark,
        protocol=conditions.rules.name,
        seed=conditions.seed,
        values=values,
        trials=tuple(trials),
        rules=own,
        controller=records.controller_record(pairing, controller),
        plant=records.plant_record(conditions.manipulator, conditions.plant_parameters),
        wall_time=end.seconds - begin.seconds,
    )
    yield Save(found)
    return found
