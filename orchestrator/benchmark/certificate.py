"""What a verification finds: figures over draws that follow from the controller and from what nobody knew before.

All values are in SI units; None stands for what does not exist.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping, Sequence

from ..codec import Natural, NonNegative, Struct, to_json
from .results import CaseResult, Kind, Rules, Scorecard
from .scorecard import score
from .spread import statistic


class Figure(Struct):
    """A figure over the draws: mean and sample standard deviation, None if a draw has no value or there is only one."""

    mean: NonNegative | None
    sd: NonNegative | None


class WorstDraw(Struct):
    """The largest value over the draws; its case is repeated with the seed of the draw."""

    id: str
    seed: Natural
    value: NonNegative | None


class CriterionFound(Figure):
    """A criterion over the draws, each as in Table 2, beside its target; and the worst case of all."""

    unit: str
    target: NonNegative
    worst_case: WorstDraw | None


class RequirementFound(Struct):
    """A requirement: whether it holds in all draws, in how many it does not, and the worst case."""

    passed: bool | None
    failed_draws: Natural
    kind: Kind
    worst_case: WorstDraw | None


class Score(Struct):
    """A controller over all draws. ``complete`` tells whether every case came to a verdict."""

    complete: bool
    cost: Figure
    criteria: dict[str, CriterionFound]
    requirements: dict[str, RequirementFound]


class Draw(Struct):
    """One draw: its seed, V, and the SHA-256 of what all its cases came to."""

    seed: Natural
    cost: NonNegative | None
    cases: str


class Tried(Score, kw_only=True):
    """A controller over all draws and in each of them, and on the list of worst cases."""

    draws: tuple[Draw, ...]
    strict: Score | None


class Reference(Tried, kw_only=True):
    """One of the benchmark's own controllers; ``file`` is the FMU that was used, in C where there is a compiler."""

    file: str


def identity(sha256: str, parameters: Mapping[str, float], mapping: Mapping[str, str], sample_time: float) -> str:
    """SHA-256 of a controller with all that makes it behave as it does."""
    used = [sha256, sorted(parameters.items()), sorted(mapping.items()), sample_time]
    return hashlib.sha256(to_json(used, indent=None).encode()).hexdigest()


def seeds(entropy: str, controller: str, count: int) -> tuple[int, ...]:
    """The seeds of ``count`` draws: whoever changes the controller, which a hash identifies, changes its draws."""
    words = (f"{entropy}\n{controller}\n{number}" for number in range(count))
    return tuple(int(hashlib.sha256(word.encode()).hexdigest()[:12], 16) for word in words)


def digest(results: Iterable[CaseResult]) -> str:
    """SHA-256 of what cases came to, to the last bit, without words."""
    told = [[each.id, each.status, each.time, each.measurements, each.warnings] for each in results]
    return hashlib.sha256(to_json(told, indent=None).encode()).hexdigest()


def overall(rules: Rules, draws: Sequence[tuple[int, Sequence[CaseResult]]]) -> Score:
    """The score of the cases of ``draws``, each with its seed."""
    cards = [(seed, score(rules, results)) for seed, results in draws]
    return Score(
        complete=all(card.complete for _, card in cards),
        cost=figure((seed, card.cost) for seed, card in cards),
        criteria={name: _criterion(name, cards) for name in rules.criteria},
        requirements={name: _requirement(name, cards) for name in cards[0][1].stability},
    )


def figure(draws: Iterable[tuple[int, float | None]]) -> Figure:
    """The figure over values by seed."""
    found = statistic(dict(draws))
    return Figure(found.mean, found.deviation)


def _criterion(name: str, cards: Sequence[tuple[int, Scorecard]]) -> CriterionFound:
    found = [(seed, card.criteria[name]) for seed, card in cards]
    worst = [WorstDraw(each.worst_case.id, seed, each.worst_case.value) for seed, each in found if each.worst_case]
    first = found[0][1]
    largest = max(worst, key=lambda each: math.inf if each.value is None else each.value, default=None)
    over = figure((seed, each.value) for seed, each in found)
    return CriterionFound(over.mean, over.sd, first.unit, first.target, largest)


def _requirement(name: str, cards: Sequence[tuple[int, Scorecard]]) -> RequirementFound:
    found = [(seed, card.stability[name]) for seed, card in cards]
    seed, worst = max(
        found, key=lambda each: (each[1].passed is False, each[1].limit_cycle is None, each[1].limit_cycle or 0.0)
    )
    case = None if worst.worst_case is None else WorstDraw(worst.worst_case, seed, worst.limit_cycle)
    verdicts = [each.passed for _, each in found]
    passed = False if False in verdicts else None if None in verdicts else True
    return RequirementFound(passed, verdicts.count(False), worst.kind, case)
