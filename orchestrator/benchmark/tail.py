"""The tail of a sample beyond its largest values: peaks over threshold.

The excesses over a high threshold follow a generalized Pareto distribution in the limit, whatever the distribution of
the draws (Balkema and de Haan, 1974; Pickands, 1975; Coles, *An Introduction to Statistical Modeling of Extreme
Values*, 2001, chapter 4). Two figures follow from it: the return level, which a given share of all draws exceeds, and
the exceedance probability of a level. Counting bounds both without any assumption, and says nothing beyond the largest
draw.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from ..codec import Finite, Natural, NonNegative, Struct

SHARE = 0.1
"""Of the draws, beyond the threshold (DuMouchel, 1983)."""

FEWEST, MOST = 40, 500
"""Excesses that a fit takes. With fewer, the intervals cover less often than they say; with more, the threshold of a
large sample would be lower than it need be."""

SHAPES = (-1.0, 2.0)
"""Shapes that are tried: below -1 the likelihood has no maximum, and beyond 1 there is no mean."""

SCALES = (math.exp(-3.0), math.exp(3.0))
"""Scales that are tried, in times of the mean excess."""

STEPS = 81
"""Shapes, and scales, of the grid on which the likelihood is looked at."""


class Interval(Struct):
    """An ``estimate``, and the ends ``low`` and ``high`` of its confidence interval."""

    estimate: Finite
    low: Finite
    high: Finite


class Tail(Struct):
    """The tail of a criterion, or of V, in independent draws, by peaks over threshold.

    Parameters
    ----------
    threshold : float
        What the peaks exceed, in the unit of the values.
    peaks : int
        Number of draws beyond the threshold.
    shape : float
        Of the generalized Pareto distribution: below 0 it has an end, at 0 it is exponential, above 0 it is heavy.
    scale : float
        Of the same distribution, in the unit of the values.
    level : Interval, optional
        The return level: the value that the document's ``probability`` of all draws exceed. None if that probability is
        not below the share of the peaks.
    exceedance : Interval, optional
        The probability that a draw exceeds the criterion's target. None if the target is not above the threshold: there
        counting is better.
    """

    threshold: Finite
    peaks: Natural
    shape: Finite
    scale: NonNegative
    level: Interval | None = None
    exceedance: Interval | None = None


def tail(values: Sequence[float | None], target: float, probability: float, confidence: float) -> Tail | None:
    """The tail of the ``values`` of independent draws.

    ``target`` is the level whose exceedance probability is asked for, ``probability`` that of the return level, and
    ``confidence`` that of both intervals, each with two sides, by profile likelihood.

    Returns None with fewer than 40 peaks, which takes 400 draws, and if a draw has no value: one that is unstable
    belongs to another mode, of which the others say nothing.
    """
    from scipy.optimize import minimize  # slow to load
    from scipy.stats import chi2, genpareto

    numbers = np.sort([value for value in values if value is not None])
    exceeding = min(math.floor(SHARE * len(numbers)), MOST)
    if len(numbers) < len(values) or exceeding < FEWEST:
        return None
    threshold = float(numbers[-exceeding - 1])
    excesses = numbers[numbers > threshold] - threshold
    # Equal values, such as a settling time of 0 s, are no peaks over themselves.
    if len(excesses) < FEWEST:
        return None
    mean, share = float(excesses.mean()), len(excesses) / len(numbers)
    allowed = 0.5 * float(chi2.ppf(confidence, 1))
    rough = _grid(excesses / mean, SHAPES, SCALES)
    # Again where the likelihood is large enough: three of its standard errors may be three steps of the whole grid.
    near = rough[2] >= rough[2].max() - 1.5 * allowed
    shapes, scales, likelihood = _grid(excesses / mean, _around(rough[0], near), _around(rough[1], near))
    first = np.unravel_index(likelihood.argmax(), likelihood.shape)
    fit = minimize(
        lambda at: -_likelihood(excesses / mean, np.array(at[0]), np.array(math.exp(at[1]))),
        (shapes[first], math.log(scales[first])),
        method="Nelder-Mead",
        bounds=(SHAPES, tuple(map(math.log, SCALES))),
        options={"xatol": 1e-9, "fatol": 1e-12},
    )
    shape, scale, best = float(fit.x[0]), math.exp(fit.x[1]), max(-float(fit.fun), float(likelihood.max()))
    left = allowed - (best - likelihood)
    inside = left >= 0.0
    c, s, spare = shapes[inside], scales[inside], left[inside]
    lowest, highest = _shares(len(excesses), len(numbers), spare)

    def interval(figure: Callable[..., np.ndarray]) -> Interval:
        """Of a figure of shape, scale and share of the peaks, which rises with the share."""
        estimate = float(figure(shape, scale, share))
        low = min(estimate, float(np.min(figure(c, s, lowest), initial=estimate)))
        return Interval(estimate, low, max(estimate, float(np.max(figure(c, s, highest), initial=estimate))))

    level = exceedance = None
    if probability < share:
        # isf needs a probability; a share below it has its level at the threshold.
        level = interval(lambda c, s, p: threshold + mean * genpareto.isf(np.minimum(probability / p, 1.0), c, scale=s))
    if target > threshold:
        exceedance = interval(lambda c, s, p: p * genpareto.sf((target - threshold) / mean, c, scale=s))
    return Tail(threshold, len(excesses), shape, mean * scale, level, exceedance)


def _likelihood(excesses: np.ndarray, shapes: np.ndarray, scales: np.ndarray) -> np.ndarray:
    """The logarithm of the likelihood of a generalized Pareto distribution of ``shapes`` and ``scales``, arrays of one
    form, for ``excesses`` of shape (N,). As ``scipy.stats.genpareto.logpdf``, summed, in a tenth of the time."""
    shapes = np.where(np.abs(shapes) < 1e-6, 1e-6, shapes)
    with np.errstate(divide="ignore", invalid="ignore"):
        logarithms = np.log1p((shapes / scales)[..., None] * excesses).sum(axis=-1)
        likelihoods = -len(excesses) * np.log(scales) - (1.0 / shapes + 1.0) * logarithms
    # An excess beyond the end of the distribution has no logarithm.
    return np.where(np.isnan(likelihoods), -np.inf, likelihoods)


def _grid(
    excesses: np.ndarray, shapes: tuple[float, float], scales: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Shapes, scales and their likelihood, arrays of shape (STEPS, STEPS)."""
    c, s = np.meshgrid(np.linspace(*shapes, STEPS), np.geomspace(*scales, STEPS), indexing="ij")
    # Row by row: all at once would take 100 MB.
    return c, s, np.array([_likelihood(excesses, *row) for row in zip(c, s, strict=True)])


def _around(values: np.ndarray, near: np.ndarray) -> tuple[float, float]:
    """The range of the ``values`` that are ``near``, and one step of the grid more, as far as it reaches."""
    steps = np.unique(values)
    low, high = np.searchsorted(steps, (values[near].min(), values[near].max()))
    return float(steps[max(low - 1, 0)]), float(steps[min(high + 1, len(steps) - 1)])


def _shares(peaks: int, draws: int, spare: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The smallest and the largest share of peaks whose binomial likelihood is at most ``spare`` below that of the
    share of the sample, of the form of ``spare``."""
    share = peaks / draws
    shares = np.linspace(0.0, min(1.0, 4.0 * share), 8001)[1:-1]
    lost = peaks * np.log(share / shares) + (draws - peaks) * np.log((1.0 - share) / (1.0 - shares))
    below, above = shares < share, shares >= share
    low = np.interp(-spare, -lost[below], shares[below])
    return low, np.interp(spare, lost[above], shares[above])
