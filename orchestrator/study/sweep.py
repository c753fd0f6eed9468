"""A grid of parameter values, every combination tried in the same cases."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from ..benchmark.results import rules
from ..documents.sweep import Sweep
from ..errors import InputError
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from ..search.candidates import Trial
from ..search.proposals import GENERATION
from .declaration import Study, described, option
from .heads import head
from .requests import Now, Requests, Save, Tell, TrialDone, rehearsed
from .tuner import attempt, values_of


@described
@dataclass(frozen=True)
class SweepStudy(Study[Sweep]):
    """V and stability over a grid of parameter values: every combination of them."""

    command = "sweep"
    suffix = "-sweep"
    protocol_option = "objective"

    values: Mapping[str, Sequence[float]] = option(
        dict,
        "a parameter and its values, evenly spaced or as a list such as 0.8,0.9,0.95, in the unit the FMU has for it; "
        "every combination is tried",
        word="vary",
        metavar="NAME=LOW:HIGH:COUNT[:log]",
        required=True,
    )
    objective: str | Path = option("tuning", "the protocol that they are tried in", asked=False)

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[Sweep]:
        """The requests of a sweep, generation by generation."""
        testbed = replace(testbed, protocol=self.objective)
        values = {name: tuple(listed) for name, listed in self.values.items()}
        if not values or not all(values.values()):
            raise InputError("Nothing varies: at least one parameter with its values is needed.", "nothing-varies")
        controller, pairing, T_s, cases = testbed.prepared(controller)
        values_of(controller, values)
        objective_rules = rules(testbed.rules)
        begin = yield Now()
        yield from rehearsed(pairing, cases[0])
        grid = [dict(zip(values, chosen, strict=True)) for chosen in itertools.product(*values.values())]
        trials: list[Trial] = []
        while asked := list(enumerate(grid))[len(trials) : len(trials) + GENERATION]:
            benches = [testbed.pairing(controller.with_parameters(chosen)) for _, chosen in asked]
            for tried in (yield from attempt(testbed.rules, objective_rules, benches, cases, asked)):
                trials.append(tried)
                yield Tell(TrialDone(tried, len(trials), len(grid)))
        end = yield Now()
        sweep = Sweep(
            schema=Sweep.SCHEMA,
            head=head(testbed, controller, pairing, T_s, begin, end),
            values=values,
            trials=tuple(trials),
        )
        yield Save(sweep)
        return sweep
