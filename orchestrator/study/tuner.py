"""The search for parameters of a controller: candidates in a short protocol, the best of them in the whole one.

What the whole protocol, or a search for the worst case, finds wrong with a candidate is added to the objective: the
next candidates are tried with it.
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

from msgspec import structs

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import Rules, rules, test_rules
from ..benchmark.spread import Statistic, statistic
from ..pairing.pairing import Pairing
from ..search.candidates import Trial, measured, trial
from ..search.proposals import GENERATION, Proposals
from .candidates import attempt
from .requests import Requests, Tell, TrialDone, side_by_side

JUDGED_EVERY = 4
"""Generations between two trials of the best candidate on the whole protocol; the first one is that of the start."""

FINALISTS = 5
"""Candidates that are tried there at the end, best first."""

FIRST_ADDED = 1000
"""From where on the configurations of cases that were added are numbered."""


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
    counterexamples are added. ``judged`` are the verdicts by the trial's number."""

    protocol: Protocol
    pairing: Callable[[Mapping[str, float]], Pairing]
    judge: Judge
    proposals: Proposals
    cases: list[Case]
    trials: list[Trial] = field(default_factory=list)
    judged: dict[int, tuple[int, CandidateVerdict]] = field(default_factory=dict)

    @property
    def rules(self) -> Rules:
        """How the objective's cases are judged, those that were added as well."""
        own = rules(self.protocol)
        tests = {test.name: test for test in (*map(test_rules, (case.test for case in self.cases)), *own.tests)}
        return structs.replace(own, tests=tuple(tests.values()))

    def search(self, budget: int) -> Requests[None]:
        """Try ``budget`` candidates, some of them on the whole protocol."""
        worst, generations = math.inf, 0
        while len(self.trials) < budget:
            asked = self.proposals.ask(budget - len(self.trials))
            first = len(self.trials)
            found = yield from self.attempt(list(enumerate(asked, start=first)), worst)
            self.proposals.tell([each.objective for each in found])
            for each in found:
                self.trials.append(each)
                yield Tell(TrialDone(each, len(self.trials), budget))
            # What V alone makes worse than half of the last generation, no sampler builds on.
            worst = statistics.median(each.objective for each in found) if first else worst
            generations += 1
            known = len(self.cases)
            if generations % JUDGED_EVERY == 1:  # from the first on, whose failures all others are then tried with
                leaders = yield from self.leaders()
                yield from self.holds(leaders[0])
            if len(self.cases) > known:
                worst = math.inf  # the objective has become another one

    def best(self) -> Requests[Trial | None]:
        """The best candidate that holds A1 to A3 on the whole protocol, of at most FINALISTS that are tried there."""
        for _ in range(FINALISTS):
            leaders = yield from self.leaders()
            holding = (each for each in leaders if each.holds and self.verdict(each) in (None, True))
            leader = next(holding, None)
            if leader is None:
                break
            if (yield from self.holds(leader)):
                return leader
        good = [self.trials[number] for number, (_, verdict) in self.judged.items() if not verdict.broken]
        again = yield from self.attempt([(each.number, each.values) for each in good], math.inf)
        return min(again, key=lambda each: each.objective, default=None)

    def attempt(self, asked: Sequence[tuple[int, dict[str, float]]], worst: float) -> Requests[list[Trial]]:
        """Trials of numbered candidates; those whose V alone exceeds ``worst`` are cut short."""
        pairings = [self.pairing(values) for _, values in asked]
        return (yield from attempt(self.protocol, self.rules, pairings, self.cases, asked, worst))

    def leaders(self) -> Requests[list[Trial]]:
        """The best candidates in all of the objective's cases, best first."""
        ranked = sorted((each for each in self.trials if not each.cut_short), key=lambda each: each.objective)
        again = yield from self.attempt([(each.number, each.values) for each in ranked[:GENERATION]], math.inf)
        for each in again:
            self.trials[each.number] = each
        return sorted(again, key=lambda each: each.objective)

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
                if all(case.scenario != known.scenario for known in self.cases):
                    # Of its own: a pose or a test of the objective may have the same number or name, and other rules.
                    number = FIRST_ADDED + len(self.cases)
                    test = structs.replace(case.test, name=f"{case.test.name}_{number}")
                    pose = replace(case.configuration, index=number)
                    self.cases.append(replace(case, configuration=pose, test=test))
        return not self.judged[candidate.number][1].broken

    def held_out(self, candidate: Trial, draws: Mapping[int, Sequence[Case]]) -> Requests[Statistic]:
        """V of the objective with other ``draws``, by seed, in place of its own; with the cases that were added."""
        pairing, own = self.pairing(candidate.values), self.rules
        added = [case for case in self.cases if case.configuration.index >= FIRST_ADDED]
        chosen = {seed: measured([*cases, *added])[0] for seed, cases in draws.items()}
        found = yield side_by_side(self.protocol, [(pairing, cases) for cases in chosen.values()])
        results = ([run.result for run in runs] for runs in found)
        costs = (trial(own, candidate.number, candidate.values, each, whole=False).cost for each in results)
        return statistic(dict(zip(chosen, costs, strict=True)))
