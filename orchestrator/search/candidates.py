"""The parameters of a controller that a tuning tries: their ranges, and what each candidate came to."""

from __future__ import annotations

import math
from collections.abc import Sequence

from ..benchmark.case import Case
from ..benchmark.protocol import Stability
from ..benchmark.results import CaseResult, Rules
from ..benchmark.scorecard import HOLDING, kind, score
from ..codec import Finite, Natural, NonNegative, Struct
from ..errors import InputError
from ..loop.trajectory import Status

REFUSED = 1000.0
"""Objective of a candidate without a cost."""

NO_CYCLE = 100.0
"""What a test of A1 to A3 without a limit cycle's amplitude, as of an unstable loop, adds to the objective."""

CYCLE, RING_DOWN = 4.0, 40.0
"""What it adds for each factor e by which a limit cycle exceeds what A3 allows, or by which it rings down too slowly:
the smaller of the two, since either would do."""

LEAST = 1.0
"""What a test in which they do not hold adds at the least."""

DIGITS = 4
"""Significant digits of a candidate's values: those that are shown, so that whoever copies them repeats it."""


class Range(Struct):
    """Where a parameter may lie, in the FMU's unit; on a logarithmic scale if ``log``."""

    low: Finite
    high: Finite
    log: bool = False

    def rounded(self, value: float) -> float:
        """The nearest value of DIGITS digits in the range."""
        return min(max(float(f"{value:.{DIGITS}g}"), self.low), self.high)

    def spaced(self, count: int) -> tuple[float, ...]:
        """At least two values from one end to the other, evenly spaced on its scale."""
        steps = [step / (count - 1) for step in range(1, count - 1)]
        ratio, width = self.high / self.low if self.log else 1.0, self.high - self.low
        between = (self.low * ratio**step if self.log else self.low + width * step for step in steps)
        return (self.low, *(float(f"{value:.12g}") for value in between), self.high)

    def place(self, value: float) -> float:
        """Where a value lies on the range's scale: 0 at its lower end, 1 at its upper one."""
        if self.log:
            return math.log(value / self.low) / math.log(self.high / self.low)
        return (value - self.low) / (self.high - self.low)


class Trial(Struct):
    """A candidate: its ``values`` by FMI name, and what it came to in the objective's cases.

    ``objective`` is ``cost``, V of eq. (15), with a penalty where A1 to A3 do not hold. ``cycle`` is the largest limit
    cycle relative to what A3 allows (None for an unstable loop, or where it was not looked for). A candidate that is
    worse than others by V alone is ``cut_short``: A1 to A3 are not tested. ``fails`` are the requirements that do not
    hold, each with its largest limit cycle relative to what A3 allows (None for an unstable loop). ``message`` says
    what went wrong without a verdict; ``judged`` is False if the candidate is not the cause.
    """

    number: Natural
    values: dict[str, Finite]
    objective: NonNegative
    cost: NonNegative | None = None
    cycle: NonNegative | None = None
    holds: bool = False
    cut_short: bool = False
    message: str = ""
    judged: bool = True
    fails: dict[str, NonNegative | None] = {}


def check_range(name: str, given: Range) -> Range:
    """``given`` if it is a range; raises :class:`InputError` if it is empty, or logarithmic and not positive."""
    if not given.low < given.high or not math.isfinite(given.low + given.high):
        message = f"The range of {name} goes from {given.low:g} to {given.high:g}: the first must be the smaller one."
        raise InputError(message, "bad-range", name)
    if given.log and given.low <= 0.0:
        message = f"The range of {name} begins at {given.low:g}: a logarithmic range has positive ends."
        raise InputError(message, "bad-range", name, given.low)
    return given


def failed(results: Sequence[CaseResult]) -> str:
    """What went wrong with a candidate that has no verdict in one of its cases; empty if nothing did."""
    for result in results:
        if result.status not in (Status.DONE, Status.UNSTABLE, Status.SKIPPED):
            return result.message.split("\n")[0] or result.status.value
    return ""


def trial(rules: Rules, number: int, values: dict[str, float], results: Sequence[CaseResult], whole: bool) -> Trial:
    """What a candidate came to: V, with penalties for A1 to A3, which are not looked at unless ``whole``.

    So without them the objective is a lower bound of the whole one.
    """
    if message := failed(results):
        return Trial(number, values, REFUSED, message=message, judged=all(map(_not_lost, results)))
    cost, limits = score(rules, results).cost, rules.stability
    bound = REFUSED if cost is None else cost
    if not whole:
        return Trial(number, values, bound, cost, cut_short=True)
    tested = [result for result in results if rules.test(result.test).requirements]
    penalties = [penalty(result, limits) for result in tested]
    largest = _ratio(limits, tested)
    failing = [result for result, added in zip(tested, penalties, strict=True) if added]
    names = sorted({name for result in failing for name in rules.test(result.test).requirements})
    fails = {
        name: _ratio(limits, [result for result in failing if name in rules.test(result.test).requirements])
        for name in names
    }
    return Trial(number, values, bound + sum(penalties), cost, largest, not failing, fails=fails)


def _ratio(limits: Stability, results: Sequence[CaseResult]) -> float | None:
    """The largest limit cycle of ``results`` relative to what A3 allows; None if one of them has no limit cycle."""
    cycles = [result.measurements.limit_cycle for result in results]
    ratios = [cycle / limits.limit_cycle for cycle in cycles if cycle is not None]
    return max(ratios) if ratios and len(ratios) == len(cycles) else None


def _not_lost(result: CaseResult) -> bool:
    return result.status is not Status.LOST


def penalty(result: CaseResult, limits: Stability) -> float:
    """What a test of A1 to A3 adds to the objective: nothing where they hold."""
    ending = kind(result, limits)
    if ending in HOLDING:
        return 0.0
    figures = result.measurements
    if figures.limit_cycle is None:
        return NO_CYCLE
    excess = CYCLE * math.log(max(figures.limit_cycle / limits.limit_cycle, 1.0))
    if ending == "limit cycle" and figures.slowest_decay is not None:
        excess = min(excess, RING_DOWN * math.log(figures.slowest_decay / limits.ring_down))
    return LEAST + excess


def measured(cases: Sequence[Case]) -> tuple[list[Case], list[Case]]:
    """The cases that V is measured in, and the others."""
    return [case for case in cases if case.test.criteria], [case for case in cases if not case.test.criteria]
