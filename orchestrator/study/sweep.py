"""A grid of parameter values, every combination tried in the same cases."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence

from ..benchmark.results import rules
from ..documents.sweep import Sweep
from ..errors import InputError
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from ..search.candidates import Trial
from ..search.proposals import GENERATION
from .candidates import attempt, values_of
from .heads import head
from .requests import Now, Save, Study, Tell, TrialDone, rehearsed


def sweep(testbed: Testbed, controller: Controller, given: Mapping[str, Sequence[float]]) -> Study[Sweep]:
    """See :meth:`.Benchmark.sweep`."""
    values = {name: tuple(map(float, each)) for name, each in given.items()}
    if not values or not all(values.values()):
        raise InputError("Nothing varies: at least one parameter with its values is needed.", "nothing-varies")
    if bad := [name for name, each in values.items() if not all(map(math.isfinite, each))]:
        raise InputError(f"The values of {bad[0]} are not finite.", "bad-number", bad[0])
    controller, pairing, T_s, cases = testbed.prepared(controller)
    values_of(controller, values)
    own = rules(testbed.rules)
    begin = yield Now()
    yield from rehearsed(pairing, cases[0])
    grid = [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]
    trials: list[Trial] = []
    while asked := list(enumerate(grid))[len(trials) : len(trials) + GENERATION]:
        benches = [testbed.pairing(controller.with_parameters(chosen)) for _, chosen in asked]
        for each in (yield from attempt(testbed.rules, own, benches, cases, asked)):
            trials.append(each)
            yield Tell(TrialDone(each, len(trials), len(grid)))
    end = yield Now()
    found = Sweep(
        schema=Sweep.SCHEMA,
        head=head(testbed, controller, pairing, T_s, begin, end),
        values=values,
        trials=tuple(trials),
    )
    yield Save(found)
    return found
