"""The search for parameters of a controller: candidates in a short protocol, the best of them in the whole one.

What the whole protocol, or a search for the worst case, finds wrong with a candidate is added to the objective: the
next candidates are tried with it.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from msgspec import structs

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, Rules, rules, test_rules
from ..benchmark.spread import Statistic, statistic
from ..errors import InputError
from ..fmi.variables import variables
from ..pairing.controller import Controller
from ..pairing.pairing import Pairing
from ..search.candidates import Trial, measured, trial
from ..search.proposals import GENERATION, Proposals
from .requests import Requests, Tell, TrialDone, side_by_side

JUDGED_EVERY = 4
"""Generations between two trials of the best candidate on the whole protocol; the first one is that of the start."""

FINALISTS = 5
"""Candidates that are tried there at the end, best first."""

FIRST_ADDED = 1000
"""From where on the configurations of cases that were added are numbered."""


def attempt(
    protocol: Protocol,
    rules: Rules,
    pairings: Sequence[Pairing],
    cases: Sequence[Case],
    asked: Sequence[tuple[int, dict[str, float]]],
    worst: float = math.inf,
) -> Requests[list[Trial]]:
    """Trials of numbered candidates, each with its pairing, in ``cases``, judged by the rules; those whose V alone
    exceeds ``worst`` are cut short."""
    performance, requirements = measured(cases)
    results: list[list[CaseResult]] = [[] for _ in asked]
    trials = [Trial(number, values, 0.0) for number, values in asked]
    alive = list(range(len(asked)))
    for stage in (performance, requirements):
        runs = yield side_by_side(protocol, [(pairings[place], stage) for place in alive])
        for place, new in zip(alive, runs, strict=True):
            results[place] += [run.result for run in new]
            trials[place] = trial(rules, *asked[place], results[place], whole=stage is requirements)
        # V first: a candidate that it alone makes worse than half of the
        # last generation is not tried in the stability tests.
        alive = [place for place in alive if not trials[place].message and trials[place].objective <= worst]
    return trials


def values_of(controller: Controller, names: Iterable[str]) -> dict[str, float]:
    """The parameters of a controller that are numbers, by FMI name: the FMU's own values, or as they are set.

    Raises :class:`InputError` if one of ``names`` is not among them.
    """
    declared = variables(controller.archive.description).values()
    start_values = {
        variable.name: variable.start[0]
        for variable in declared
        if variable.causality == "parameter" and len(variable.start) == 1
    }
    values = {**start_values, **controller.setup.parameters}
    numbers = {name: float(value) for name, value in values.items() if not isinstance(value, bool | str)}
    if unknown := sorted(set(names) - numbers.keys()):
        message = f"{controller.name} has no parameter {unknown[0]}. It has: {', '.join(numbers) or 'none'}."
        raise InputError(message, "no-parameter", controller.name, unknown[0], tuple(numbers))
    return numbers


class CandidateVerdict(NamedTuple):
    """What the whole protocol says of a candidate: V, V with the worst cases found, the requirements that do not hold,
    the cases to add to the objective, each with the command that repeats it, and why the requirements do not hold."""

    cost: float | None
    worst_cost: float | None
    broken: tuple[str, ...]
    counterexamples: Sequence[tuple[Case, str]]
    reasons: tuple[str, ...] = ()


Judge = Callable[[Trial], Requests[CandidateVerdict]]
"""Tries a candidate on the whole protocol."""


@dataclass
class Tuner:
    """A search for parameters: ``pairing`` makes a candidate's, ``cases`` of ``protocol`` are the objective, to which
    counterexamples are added. ``judged`` are the verdicts by the trial's number, and ``counted`` how many cases its
    objective counts."""

    protocol: Protocol
    pairing: Callable[[Mapping[str, float]], Pairing]
    judge: Judge
    proposals: Proposals
    cases: list[Case]
    trials: list[Trial] = field(default_factory=list)
    judged: dict[int, tuple[int, CandidateVerdict]] = field(default_factory=dict)
    counted: dict[int, int] = field(default_factory=dict)

    @property
    def rules(self) -> Rules:
        """How the objective's cases are judged, those that were added as well."""
        protocol_rules = rules(self.protocol)
        tests = {
            test.name: test for test in (*map(test_rules, (case.test for case in self.cases)), *protocol_rules.tests)
        }
        return structs.replace(protocol_rules, tests=tuple(tests.values()))

    def search(self, budget: int) -> Requests[None]:
        """Try ``budget`` candidates, some of them on the whole protocol."""
        worst, generations = math.inf, 0
        while len(self.trials) < budget:
            asked = self.proposals.ask(budget - len(self.trials))
            first = len(self.trials)
            generation = yield from self.attempt(list(enumerate(asked, start=first)), worst)
            self.proposals.tell([tried.objective for tried in generation])
            for tried in generation:
                self.trials.append(tried)
                self.counted[tried.number] = len(self.cases)
                yield Tell(TrialDone(tried, len(self.trials), budget, self.leading()))
            # What V alone makes worse than half of the last generation, no sampler builds on.
            worst = statistics.median(tried.objective for tried in generation) if first else worst
            generations += 1
            size = len(self.cases)
            if generations % JUDGED_EVERY == 1:  # from the first on, whose failures all others are then tried with
                leaders = yield from self.leaders()
                yield from self.holds(leaders[0])
            if len(self.cases) > size:
                worst = math.inf  # the objective has become another one

    def best(self) -> Requests[Trial | None]:
        """The best candidate that holds A1 to A3 on the whole protocol, of at most FINALISTS that are tried there."""
        for _ in range(FINALISTS):
            leaders = yield from self.leaders()
            holding = (tried for tried in leaders if tried.holds and self.verdict(tried) in (None, True))
            leader = next(holding, None)
            if leader is None:
                break
            if (yield from self.holds(leader)):
                return leader
        good = [self.trials[number] for number, (_, verdict) in self.judged.items() if not verdict.broken]
        again = yield from self.attempt([(tried.number, tried.values) for tried in good], math.inf)
        return min(again, key=lambda tried: tried.objective, default=None)

    def attempt(self, asked: Sequence[tuple[int, dict[str, float]]], worst: float) -> Requests[list[Trial]]:
        """Trials of numbered candidates; those whose V alone exceeds ``worst`` are cut short."""
        pairings = [self.pairing(values) for _, values in asked]
        return (yield from attempt(self.protocol, self.rules, pairings, self.cases, asked, worst))

    def leaders(self) -> Requests[list[Trial]]:
        """The best candidates in all of the objective's cases, best first."""
        ranked = sorted((tried for tried in self.trials if not tried.cut_short), key=lambda tried: tried.objective)
        again = yield from self.attempt([(tried.number, tried.values) for tried in ranked[:GENERATION]], math.inf)
        for tried in again:
            self.trials[tried.number] = tried
            self.counted[tried.number] = len(self.cases)
        return sorted(again, key=lambda tried: tried.objective)

    def leading(self) -> Trial | None:
        """The best of the candidates that have been tried in all of the objective's cases so far."""
        tried = (
            trial for trial in self.trials if not trial.cut_short and self.counted[trial.number] == len(self.cases)
        )
        return min(tried, key=lambda candidate: candidate.objective, default=None)

    def verdict(self, candidate: Trial) -> bool | None:
        """Whether a candidate holds A1 to A3 on the whole protocol; None if it has not been tried there."""
        entry = self.judged.get(candidate.number)
        return None if entry is None else not entry[1].broken

    def holds(self, candidate: Trial) -> Requests[bool]:
        """The same, tried now if it has not been; what fails is added to the objective."""
        if candidate.number not in self.judged:
            verdict = yield from self.judge(candidate)
            self.judged[candidate.number] = (len(self.trials), verdict)
            for case, _ in verdict.counterexamples:
                if all(case.scenario != other.scenario for other in self.cases):
                    # Of its own: a pose or a test of the objective may have the same number or name, and other rules.
                    number = FIRST_ADDED + len(self.cases)
                    test = structs.replace(case.test, name=f"{case.test.name}_{number}")
                    pose = replace(case.configuration, index=number)
                    self.cases.append(replace(case, configuration=pose, test=test))
        return not self.judged[candidate.number][1].broken

    def held_out(self, candidate: Trial, draws: Mapping[int, Sequence[Case]]) -> Requests[Statistic]:
        """V of the objective with other ``draws``, by seed, in place of its own; with the cases that were added."""
        pairing, objective_rules = self.pairing(candidate.values), self.rules
        added = [case for case in self.cases if case.configuration.index >= FIRST_ADDED]
        chosen = {seed: measured([*cases, *added])[0] for seed, cases in draws.items()}
        by_draw = yield side_by_side(self.protocol, [(pairing, cases) for cases in chosen.values()])
        results = ([run.result for run in runs] for runs in by_draw)
        costs = (
            trial(objective_rules, candidate.number, candidate.values, drawn, whole=False).cost for drawn in results
        )
        return statistic(dict(zip(chosen, costs, strict=True)))
