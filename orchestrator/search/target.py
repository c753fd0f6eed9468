"""What a search makes as large as it can: a criterion, or how badly a stability test ends."""

from __future__ import annotations

import math
from dataclasses import dataclass

from ..benchmark.protocol import Protocol, Stability
from ..benchmark.results import Judgement
from ..benchmark.scorecard import outcome
from ..benchmark.tally import UNJUDGED

HEAVIEST = 3
"""Criteria that are searched for; the others have a hundredth of V each."""

FAILED = 1e3
"""Beyond every severity of a test that holds."""


@dataclass(frozen=True)
class Target:
    """A criterion by its name, or a stability test, whose ``criterion`` is empty; both are measured in ``test``."""

    name: str
    test: str
    criterion: str = ""


def targets(protocol: Protocol) -> tuple[Target, ...]:
    """What is searched for: the heaviest criteria of disturbed tests, and the tests of A1 and A2."""
    disturbed = [test for test in protocol.tests if test.disturbed]
    by_weight = sorted(protocol.criteria, key=lambda name: -protocol.criteria[name].weight)
    tests = ((name, next((test.name for test in disturbed if name in test.criteria), "")) for name in by_weight)
    criteria = [Target(name, test, name) for name, test in tests if test][:HEAVIEST]
    return (*criteria, *(Target(test.name, test.name) for test in disturbed if test.axis and not test.repeats))


def fails(result: Judgement, limits: Stability) -> bool:
    """Whether a simulation breaks a requirement; one that was skipped or lost does not."""
    return outcome(result, limits) not in ("holds", *UNJUDGED)


def severity(target: Target, result: Judgement, limits: Stability) -> float:
    """How bad ``result`` is; only comparisons are meant.

    A criterion's value, infinite for a loop that is unstable. Of a stability test the time until the TCP error stays
    small: the amplitude at the end is noise below a cliff, and says nothing of what is near. One that fails is beyond,
    by its amplitude.
    """
    figures = result.measurements
    if not result.simulated:
        return -math.inf
    if target.criterion:
        value = getattr(figures, target.criterion)
        return math.inf if value is None else float(value)
    if fails(result, limits):
        return FAILED + (math.log10(figures.limit_cycle) if figures.limit_cycle else FAILED)
    return (figures.recovery or 0.0) + (figures.limit_cycle_ratio or 0.0)
