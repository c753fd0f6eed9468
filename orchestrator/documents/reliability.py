"""The answer of a sample of independent draws: what ``reliability.json`` holds, and its words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import ClassVar

from ..benchmark.reliability import Distribution, Failing, Probability, Quantile, failing, quantile
from ..benchmark.tail import Tail
from ..codec import Natural
from ..views.plot import Axis, Level, Line, Plot, hue
from ..views.table import Cell, Column, Conclusion, Facts, Link, Note, Part, Quantity, Summary, Table, Value
from ..views.units import NONE, SHOWN, number
from . import conclusions
from .commands import ROBUST, study_command, tune_command
from .conclusions import costliest, decisive, listed, overall
from .document import Comparable, Completeness, Document, Rank, Row
from .files import RELIABILITY, REPORT
from .wording import Reason, carry_over, head_facts, reason_notes

SHOWN_FAILURES = 20
"""So many failures are shown; the document has all of them."""

POINTS = 100
"""So many values of a distribution are drawn."""

HEAVY = 3
"""Criteria whose distribution is drawn, those of the largest weights."""


class Reliability(Document, Comparable, kw_only=True):
    """What a sample of independent draws of arm, pose, direction of the force, sweep and noise came to; shows itself in
    a notebook. All values are in SI units.

    With the ``confidence``, the probability that a draw breaks a requirement is at most the ``bound`` of
    ``requirements``, and at most the share ``probability`` of all draws exceed the ``bound`` of a criterion, or of V of
    a draw (``cost``).

    With ``only``, a part of the tests was simulated: there are the requirements and criteria whose tests are among
    these, the tests that it names, and V if there are all criteria; else no draw is judged in ``cost``.

    ``tails`` estimates, by the name of a criterion or ``"V"``, what lies beyond the largest draws, where 400 draws or
    more have a value: a :class:`.Tail`. Unlike the bounds it assumes that the draws have shown all there is to see.
    """

    FILE: ClassVar[str] = RELIABILITY
    SCHEMA: ClassVar[str] = "flexible-manipulator-reliability/1"
    KIND: ClassVar[str] = "Samples of independent draws, upper bounds"
    DERIVED: ClassVar[tuple[str, ...]] = (REPORT,)

    distribution: Distribution
    draws: Natural
    probability: Probability
    confidence: Probability
    requirements: dict[str, Failing]
    criteria: dict[str, Quantile]
    cost: Quantile
    only: tuple[str, ...] = ()
    tails: dict[str, Tail] = {}

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        judged = all(entry.judged == self.draws for entry in self.requirements.values())
        return "complete" if judged else "not judged"

    def _problem(self) -> str:
        for entry in self.requirements.values():
            if entry != failing(entry.failures, entry.judged, self.confidence):
                return "a bound is not that of its failures"
        for sample in (self.cost, *self.criteria.values()):
            without = [None] * (sample.judged - len(sample.values))
            if sample != quantile([*sample.values, *without], self.probability, self.confidence):
                return "a quantile is not that of its values"
        samples = {**self.criteria, "V": self.cost}
        if any(name not in samples or not _fits(fitted, samples[name]) for name, fitted in self.tails.items()):
            return "a tail is not that of its values"
        names = self.rules.criteria.keys()
        if self.criteria.keys() == names or (self.only and self.criteria.keys() <= names and not self.cost.judged):
            return ""
        return "its criteria are not those of its rules"

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        held = not any(entry.failures for entry in self.requirements.values())
        reason = "" if self.cost.bound is not None else "no bound of V: too few draws, or one is unstable"
        return Rank(self.cost.bound, held, reason)

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """The bounds of the probabilities of failure, and of V."""
        cells: list[tuple[Column, Cell]] = [(Column("draws"), f"{self.draws} ({self.distribution})")]
        cells += [
            (Column(f"{name} fails"), Value(requirement.bound, beyond="<"))
            for name, requirement in self.requirements.items()
        ]
        return *cells, (Column("V", best="smallest"), Value(self.cost.bound, beyond="<"))

    def summary(self) -> Summary:
        """Probabilities of failure, quantiles, their distribution, and the failures with their commands."""
        level = f"{self.confidence:g} confidence"
        parts: list[Part] = [self._failing(level)]
        if self.criteria:
            parts += [self._quantiles(level), *self._tails(level), self._distribution()]
        parts += reason_notes(reliability_reasons(self))
        if self.cost.judged and self.cost.bound is None:
            parts.append(Note("V has no bound: there are too few draws, or too many without a V.", warning=True))
        kicker = (
            f"{self.benchmark}, protocol {self.protocol}, seed {self.seed}, {self.draws} independent draws, "
            f"distribution {self.distribution}" + (f", only {', '.join(self.only)}" if self.only else "")
        )
        facts = Facts("This sample", tuple(head_facts(self.head)))
        return Summary(self.controller.file, kicker, (*map(Note, carry_over(self.head)), *parts, facts))

    def conclusion(self) -> Conclusion:
        """How many draws break a requirement, the bounds that follow, and the criterion that costs most."""
        passed = {name: self._passed(entry) for name, entry in self.requirements.items()}
        medians = {name: sample.median for name, sample in self.criteria.items()}
        total = ""
        if self.cost.judged:
            most = f"V is above {number(self.cost.bound)} in at most {_percent(self.probability)} of all draws"
            target = f"target {self.rules.cost.target:g}"
            total = f"no bound of V ({target})" if self.cost.bound is None else f"{most} ({target})"
            if (costly := costliest(self.rules, medians)) is not None:
                total += f", and {costly[0]} costs most in the median, {_percent(costly[1])}"
        steps = [
            Link("simulate the first failure", entry.failures[0].command)
            for entry in self.requirements.values()
            if entry.failures
        ][:1]
        steps.append(Link("search for the worst case", study_command(self.head, "robustness")))
        if any(entry.failures for entry in self.requirements.values()):
            steps.append(Link("tune against the worst case", tune_command(self.head, *ROBUST)))
        return conclusions.conclusion(overall(passed), (self._broken(passed), total), steps)

    def _passed(self, entry: Failing) -> bool | None:
        """False if a draw fails, None if one is not judged."""
        if entry.failures:
            return False
        return True if entry.judged == self.draws else None

    def _broken(self, passed: Mapping[str, bool | None]) -> str:
        """The requirement that most draws break, with the bound of its probability of failure."""
        if not passed:
            return ""
        names = decisive(passed)
        worst = max(names, key=lambda name: self.requirements[name].bound)
        entry = self.requirements[worst]
        bound = f"so at most {_percent(entry.bound)} of all draws do (confidence {self.confidence:g})"
        failed = len({failure.draw for failure in entry.failures})
        if failed:
            return f"{worst} fails in {failed} of {entry.judged} draws, {bound}"
        return f"None of {entry.judged} draws breaks {listed(names)}, {bound}"

    def _failing(self, level: str) -> Table:
        columns = (Column("requirement"), Column("draws"), Column("failed"), Column("share"), Column("at most"))
        rows = tuple(
            (
                name,
                requirement.judged,
                len({one.draw for one in requirement.failures}),
                requirement.estimate,
                requirement.bound,
            )
            for name, requirement in self.requirements.items()
        )
        return Table(f"Probability of failure, at {level}", columns, rows)

    def _quantiles(self, level: str) -> Table:
        columns = (Column(""), Column("median"), Column("largest"), Column("bound"), Column("target"))
        rows: list[tuple[Cell, ...]] = []
        for name, sample in self.criteria.items():
            spec = self.rules.criteria[name]
            unit = SHOWN[spec.unit]
            values = (Value(value, unit=unit) for value in (sample.median, sample.largest, sample.bound, spec.target))
            rows.append((Quantity(name, unit), *values))
        if self.cost.judged:
            rows.append(("V", self.cost.median, self.cost.largest, self.cost.bound, self.rules.cost.target))
        return Table(f"Bounds that at most {self.probability:g} of all draws exceed, at {level}", columns, tuple(rows))

    def _tails(self, level: str) -> Iterator[Table]:
        rows: list[tuple[Cell, ...]] = []
        for name, fitted in self.tails.items():
            unit = SHOWN[self.rules.criteria[name].unit] if name in self.rules.criteria else NONE
            ends = 3 * (None,) if fitted.level is None else (fitted.level.estimate, fitted.level.low, fitted.level.high)
            likely = (
                3 * (None,)
                if fitted.exceedance is None
                else (fitted.exceedance.estimate, fitted.exceedance.low, fitted.exceedance.high)
            )
            levels = (Value(value, unit=unit) for value in ends)
            rows.append((Quantity(name, unit) if unit is not NONE else name, *levels, *likely))
        if rows:
            columns = ("", "return level", "from", "to", "beyond target", "from", "to")
            words = (
                f"Peaks over threshold. Return level: what {self.probability:g} of all draws exceed. Beyond target: "
                "the probability that a draw is. Both are extrapolated: what none of the draws has hit is not in them."
            )
            yield Table(f"Estimated tail, at {level}", tuple(map(Column, columns)), tuple(rows), caption=words)

    def _distribution(self) -> Plot:
        by_weight = sorted(self.criteria, key=lambda name: -self.rules.criteria[name].weight)[:HEAVY]
        quantiles = {"V": (self.cost, self.rules.cost.target)} if self.cost.judged else {}
        quantiles |= {name: (self.criteria[name], self.rules.criteria[name].target) for name in by_weight}
        series = tuple(
            _exceeding(name, values, target, place) for place, (name, (values, target)) in enumerate(quantiles.items())
        )
        axes = Axis("value, in times of its target"), Axis("share of the draws that exceed it")
        levels = (Level(self.probability, "probability"),)
        largest = (
            f"{name} {number(values.largest / target)}"
            for name, (values, target) in quantiles.items()
            if values.largest is not None
        )
        text = (
            "Share of the draws that exceed a value, in times of its target; the largest of all: "
            f"{', '.join(largest) or 'none'}. The line at {self.probability:g} is the probability that is asked for."
        )
        return Plot("exceedance-plot", "How many draws exceed a value", *axes, series, levels, text=text)

    def __repr__(self) -> str:
        bounds = ", ".join(
            f"{name} fails < {number(requirement.bound)}" for name, requirement in self.requirements.items()
        )
        return f"Reliability({self.controller.file}, {self.draws} draws: {bounds})"


def _percent(share: float) -> str:
    return f"{number(100.0 * share)} %"


def _fits(fitted: Tail, sample: Quantile) -> bool:
    """Whether a tail may be that of a sample. It is not fitted again: another version of SciPy has other bits."""
    intervals = [interval for interval in (fitted.level, fitted.exceedance) if interval is not None]
    return (
        len(sample.values) == sample.judged
        and fitted.peaks == sum(value > fitted.threshold for value in sample.values)
        and all(interval.low <= interval.estimate <= interval.high for interval in intervals)
    )


def _exceeding(name: str, sample: Quantile, target: float, order: int) -> Line:
    """The share of the draws above values of the sample, of which at most POINTS are shown, evenly chosen."""
    count = len(sample.values)
    places = sorted({round(step * (count - 1) / (POINTS - 1)) for step in range(POINTS)}) if count else []
    shares = [1.0 - (place + 1) / sample.judged for place in places]
    x = [sample.values[place] / target for place in places]
    return Line(name, x, shares, hue(order), symbol="circle")


def reliability_reasons(reliability: Reliability) -> list[Reason]:
    """The first failures of each requirement."""
    return [
        Reason(f"{name} fails in draw {failure.draw}, {failure.test}: {failure.outcome}", failure.command)
        for name, requirement in reliability.requirements.items()
        for failure in requirement.failures[:SHOWN_FAILURES]
    ]
