"""What a sample of independent draws says about all: probabilities of failure and quantiles, with confidence."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec

from ..codec import Finite, Natural, NonNegative, Struct

Probability = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]

Distribution = Literal["box", "corners"]
"""Of the uncertain parameters: uniform and independent within Table 1, or each at one of its two ends, as likely."""


class Failure(Struct):
    """A draw in which a requirement fails: the number of the draw, the test, the words of the outcome, and the
    ``command`` that repeats it."""

    draw: Natural
    test: str
    outcome: str
    command: str


class Failing(Struct):
    """How often a requirement failed in independent draws, of those that were judged, and what follows for its
    probability of failure: ``estimate`` and, with the confidence of the document, at most ``bound``."""

    judged: Natural
    failures: tuple[Failure, ...]
    estimate: Probability | None
    bound: Probability


class Quantile(Struct):
    """Of a criterion, or of V of a draw: the ``median`` and the ``largest`` of the sample, and a ``bound`` that at most
    the document's ``probability`` of all draws exceed, with its confidence; None if the sample is too small, or a draw
    that decides it has no value. ``values`` are sorted, those that there are; ``judged`` counts also those without."""

    judged: Natural
    median: Finite | None
    largest: Finite | None
    bound: Finite | None
    values: tuple[NonNegative, ...]


def probability_bound(failures: int, draws: int, confidence: float) -> float:
    """Upper bound of a probability of failure after ``failures`` in so many independent ``draws`` (Clopper and Pearson,
    1934): the largest p with P(at most ``failures`` | p) >= 1 - ``confidence``."""
    from scipy.stats import beta  # slow to load

    return 1.0 if failures >= draws else float(beta.ppf(confidence, failures + 1, draws - failures))


def draws_needed(probability: float, confidence: float, failures: int = 0) -> int:
    """The smallest number of draws with so many failures that bounds the probability of failure by ``probability``;
    both lie between 0 and 1."""
    low, high = failures, max(1, failures)
    # The bound falls with the draws, so doubling and halving find the number in some 20 steps.
    while probability_bound(failures, high, confidence) > probability:
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        if probability_bound(failures, middle, confidence) > probability:
            low = middle
        else:
            high = middle
    return high


def rank_from_top(draws: int, probability: float, confidence: float) -> int:
    """The place r from the top of a sorted sample whose value bounds the quantile 1 - ``probability`` from above
    (Wilks, 1941): the largest r with P(less than r of the draws are beyond the quantile) <= 1 - ``confidence``; 0 if
    the sample is too small."""
    from scipy.stats import binom  # slow to load

    places = range(draws + 1)
    return next((r - 1 for r in places if r and binom.cdf(r - 1, draws, probability) > 1.0 - confidence), 0)


def failing(failures: Sequence[Failure], judged: int, confidence: float) -> Failing:
    """What ``judged`` draws, with these failures among them, say."""
    count = len({failure.draw for failure in failures})
    bound = probability_bound(count, judged, confidence) if judged else 1.0
    return Failing(judged, tuple(failures), count / judged if judged else None, bound)


def quantile(values: Sequence[float | None], probability: float, confidence: float) -> Quantile:
    """The quantile of a figure in independent draws; one without a value is worse than all others."""
    numbers = sorted(value for value in values if value is not None)
    # A draw that failed has no V. Left out, the worst draws would improve the quantile.
    ordered = [*numbers, *([math.inf] * (len(values) - len(numbers)))]
    place = rank_from_top(len(ordered), probability, confidence)
    bound = ordered[-place] if place else math.inf
    middle = ordered[(len(ordered) - 1) // 2] if ordered else math.inf
    largest = ordered[-1] if ordered else math.inf
    finite = [value if math.isfinite(value) else None for value in (middle, largest, bound)]
    return Quantile(len(values), finite[0], finite[1], finite[2], tuple(numbers))
