"""What a verification finds: figures over draws that follow from the controller and from what nobody knew before.

All values are in SI units; None stands for what does not exist.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Sequence

from msgspec import structs

from ..codec import Natural, NonNegative, Struct, to_json
from ..loop.trajectory import Status
from .draws import Entropy
from .results import CaseResult, Kind, Requirement, Rules, Scorecard
from .scorecard import score
from .spread import statistic
from .tally import Tally, merged, reason, with_given_up


class Figure(Struct):
    """A figure over the draws: mean and sample standard deviation, None if a draw has no value or there is only one."""

    mean: NonNegative | None
    sd: NonNegative | None


class WorstDraw(Struct):
    """The largest value over the draws; its case is repeated with the seed of the draw."""

    id: str
    seed: Natural
    value: NonNegative | None


class CriterionOverDraws(Figure):
    """A criterion over the draws, each as in Table 2, beside its target; and the worst case of all."""

    unit: str
    target: NonNegative
    worst_case: WorstDraw | None


class RequirementOverDraws(Struct):
    """A requirement over the draws.

    ``passed`` is False if it is not met in a draw (there are ``failed_draws`` of them), else None if it is not judged
    in one, else True. A case that was skipped counts as failed: only failures of the controller in others cause that.
    ``tally`` counts the cases of all draws. ``worst_case`` is that of the worst draw, or the first
    case that was lost; it has no value then.
    """

    passed: bool | None
    failed_draws: Natural
    kind: Kind
    worst_case: WorstDraw | None
    tally: Tally

    @property
    def reason(self) -> str:
        """Why it is not met or not judged, in words; empty if it is met."""
        return reason(self.tally)


# The names of version 1.0.0, which its API page promises.
CriterionFound, RequirementFound = CriterionOverDraws, RequirementOverDraws


class CaseEnding(Struct, omit_defaults=True):
    """How a case of a draw ended, at which simulated ``time`` [s], and why if not with ``done``."""

    id: str
    seed: Natural
    status: Status
    time: NonNegative
    message: str = ""

    @property
    def simulated(self) -> bool:
        """As in :class:`.results.Judgement`."""
        return self.status in (Status.DONE, Status.UNSTABLE)


class Score(Struct):
    """A controller over all draws: its figures, and how each case ended. ``complete`` tells whether all ended with
    ``done`` or ``unstable``."""

    complete: bool
    cost: Figure
    criteria: dict[str, CriterionOverDraws]
    requirements: dict[str, RequirementOverDraws]
    cases: tuple[CaseEnding, ...]


class Difference(Struct):
    """The largest difference of one comparison of the second checker, and its bound."""

    name: str
    unit: str
    difference: NonNegative
    bound: NonNegative


class CheckedCase(Struct):
    """A case that the second checker has computed anew."""

    id: str
    seed: Natural
    differences: tuple[Difference, ...]


class Draw(Struct):
    """One draw: its seed, V, and the SHA-256 of what all its cases came to."""

    seed: Natural
    cost: NonNegative | None
    cases: str


class DrawnResults(Score, kw_only=True):
    """A controller over all draws and in each of them, and on the list of worst cases."""

    draws: tuple[Draw, ...]
    strict: Score | None


class Reference(DrawnResults, kw_only=True):
    """One of the benchmark's own controllers; ``file`` is the FMU that was used, in C where there is a compiler."""

    file: str


def seeds(entropy: Entropy, sha256: str, count: int, repetition: int = 0) -> tuple[int, ...]:
    """The seeds of ``count`` draws of the FMU with this ``sha256``; a ``repetition`` has others.

    They follow from nothing else: with one FMU and one round of the beacon, nobody can choose among draws. Without the
    FMU, one could be made for the draws of a round of the beacon that is known already. Only those of a round of people
    follow from its entropy alone, which is drawn later than all its FMUs: places by V compare what met the same draws.
    """
    whose = "" if entropy.source == "round" else sha256
    # Neither parameters nor mapping: 60 spellings of one PID gave 60 sets of
    # draws, with V from 115.1 to 138.5 (the plain one had 130.8).
    words = (f"{entropy.value}\n{whose}\n{repetition * count + number}" for number in range(count))
    # 48 bits: a seed is a number in JSON, which is exact up to 2**53.
    return tuple(int(hashlib.sha256(word.encode()).hexdigest()[:12], 16) for word in words)


def digest(results: Iterable[CaseResult]) -> str:
    """SHA-256 of what cases came to, to the last bit, without words."""
    # Without messages: their words may change with a version, the numbers may not.
    told = [[result.id, result.status, result.time, result.measurements, result.warnings] for result in results]
    return hashlib.sha256(to_json(told, indent=None).encode()).hexdigest()


def overall(rules: Rules, draws: Sequence[tuple[int, Sequence[CaseResult]]]) -> Score:
    """The score of the cases of ``draws``, each with its seed."""
    cards = [(seed, score(rules, results)) for seed, results in draws]
    return Score(
        complete=all(card.complete for _, card in cards),
        cost=figure((seed, card.cost) for seed, card in cards),
        criteria={name: _criterion(name, cards) for name in rules.criteria},
        requirements={name: _requirement(name, cards) for name in cards[0][1].stability},
        cases=tuple(
            CaseEnding(result.id, seed, result.status, result.time, result.message)
            for seed, results in draws
            for result in results
        ),
    )


def figure(draws: Iterable[tuple[int, float | None]]) -> Figure:
    """The figure over values by seed."""
    over_draws = statistic(dict(draws))
    return Figure(over_draws.mean, over_draws.deviation)


def _criterion(name: str, cards: Sequence[tuple[int, Scorecard]]) -> CriterionOverDraws:
    scores = [(seed, card.criteria[name]) for seed, card in cards]
    worst = [
        WorstDraw(criterion.worst_case.id, seed, criterion.worst_case.value)
        for seed, criterion in scores
        if criterion.worst_case
    ]
    first = scores[0][1]
    largest = max(worst, key=lambda draw: math.inf if draw.value is None else draw.value, default=None)
    over = figure((seed, criterion.value) for seed, criterion in scores)
    return CriterionOverDraws(over.mean, over.sd, first.unit, first.target, largest)


def _requirement(name: str, cards: Sequence[tuple[int, Scorecard]]) -> RequirementOverDraws:
    drawn = [(seed, _failing(card.stability[name])) for seed, card in cards]

    def badness(draw: tuple[int, Requirement]) -> tuple[bool, bool, bool, float]:
        requirement = draw[1]
        return (
            requirement.passed is False,
            requirement.passed is None,
            requirement.limit_cycle is None,
            requirement.limit_cycle or 0.0,
        )

    seed, worst = max(drawn, key=badness)
    id = worst.tally.first or worst.worst_case
    value = worst.limit_cycle if id == worst.worst_case else None
    over = merged((requirement.tally for _, requirement in drawn), worst.tally.first)
    return RequirementOverDraws(
        passed=over.passed,
        failed_draws=sum(requirement.passed is False for _, requirement in drawn),
        kind=worst.kind if id == worst.worst_case else "no verdict",
        worst_case=None if id is None else WorstDraw(id, seed, value),
        tally=over,
    )


def _failing(requirement: Requirement) -> Requirement:
    """The same requirement where a case that was skipped has failed."""
    tally = with_given_up(requirement.tally)
    return structs.replace(requirement, tally=tally, passed=tally.passed)
