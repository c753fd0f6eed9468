"""How results vary with the seed: sample statistics over evaluations that differ in it alone."""

from __future__ import annotations

import math
import statistics
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence

from ..codec import Finite, Natural, NonNegative, Struct
from .results import CaseResult, Rules, Scorecard
from .tally import Tally


class SeedScore(Struct):
    """What the evaluation with one seed came to: V, B1 to B7 as in :class:`.CriterionScore`, and which requirements
    are met (None: not judged), with the tallies of their cases. A value is None where a case that counts has none, as
    if it is unstable. ``ended`` counts the cases that were not simulated to their end, by their status."""

    seed: Natural
    cost: NonNegative | None
    criteria: dict[str, NonNegative | None]
    requirements: dict[str, bool | None]
    tallies: dict[str, Tally] = {}
    ended: dict[str, Natural] = {}


class Statistic(Struct):
    """Mean, sample standard deviation (over n - 1; None for a single seed), smallest and largest value.

    ``without`` lists the seeds that have no value: that is worse than any, so there is no mean nor a largest one then.
    """

    mean: Finite | None
    deviation: NonNegative | None
    smallest: Finite | None
    largest: Finite | None
    without: tuple[Natural, ...] = ()


class Holding(Struct):
    """With how many of how many seeds, of those that it was judged with, a requirement is met."""

    seeds: Natural
    of: Natural


class Paired(Struct):
    """The differences of V between two controllers, seed by seed: ``difference`` over the ``seeds`` that both have,
    and for how many of them the other's V is the larger one."""

    seeds: tuple[Natural, ...]
    difference: Statistic
    better: Natural


class SeedSummary(Struct):
    """The statistics over all seeds, of V and of each criterion, and the requirements."""

    cost: Statistic
    criteria: dict[str, Statistic]
    requirements: dict[str, Holding]


def seed_score(seed: int, card: Scorecard, cases: Iterable[CaseResult]) -> SeedScore:
    """The score of the evaluation with this seed, from these cases."""
    return SeedScore(
        seed=seed,
        cost=card.cost,
        criteria={name: entry.value for name, entry in card.criteria.items()},
        requirements={name: entry.passed for name, entry in card.stability.items()},
        tallies={name: entry.tally for name, entry in card.stability.items()},
        ended=dict(Counter(case.status.value for case in cases if not case.simulated)),
    )


def summary(rules: Rules, scores: Sequence[SeedScore], incomplete: Sequence[SeedScore] = ()) -> SeedSummary:
    """The statistics of ``scores``, which have the criteria of ``rules``. Of evaluations that are ``incomplete`` only
    the requirements count: a failure is one, whatever was not run."""
    verdicts: dict[str, list[bool]] = {}
    for score in (*scores, *incomplete):
        for name, passed in score.requirements.items():
            verdicts.setdefault(name, []).extend([] if passed is None else [passed])
    return SeedSummary(
        cost=statistic({score.seed: score.cost for score in scores}),
        criteria={name: statistic({score.seed: score.criteria[name] for score in scores}) for name in rules.criteria},
        requirements={name: Holding(sum(passed), len(passed)) for name, passed in verdicts.items()},
    )


def statistic(values: Mapping[int, float | None]) -> Statistic:
    """The statistic of values by seed."""
    numbers = [value for value in values.values() if value is not None]
    without = tuple(seed for seed, value in values.items() if value is None)
    every = bool(numbers) and not without
    return Statistic(
        mean=statistics.fmean(numbers) if every else None,
        deviation=statistics.stdev(numbers) if every and len(numbers) > 1 else None,
        smallest=min(numbers, default=None),
        largest=max(numbers) if every else None,
        without=without,
    )


def paired(scores: Sequence[SeedScore], others: Sequence[SeedScore]) -> Paired | None:
    """V of ``scores`` minus that of ``others``, seed by seed; None if they share no seed. An unstable evaluation is
    worse than any other."""
    costs = {score.seed: score.cost for score in others}
    shared = {score.seed: (score.cost, costs[score.seed]) for score in scores if score.seed in costs}
    if not shared:
        return None
    difference = statistic(
        # Pairs of one seed: the same arms, disturbances and noise, so their chance does not count.
        {seed: None if cost is None or other is None else cost - other for seed, (cost, other) in shared.items()}
    )
    return Paired(tuple(shared), difference, sum(_rank(cost) < _rank(other) for cost, other in shared.values()))


def _rank(cost: float | None) -> float:
    return math.inf if cost is None else cost
