"""The answer of a tuning: what ``tuning.json`` holds, and its words."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from ..benchmark.spread import Statistic
from ..codec import Finite, Natural, NonNegative, Struct
from ..search.candidates import Range, Trial
from ..views.table import (
    Beside,
    Cell,
    Choice,
    Column,
    Commands,
    Conclusion,
    Facts,
    Headline,
    Link,
    Note,
    Page,
    Panel,
    Part,
    Summary,
    Table,
    Value,
    VerdictCell,
)
from ..views.units import number
from . import conclusions, tuning_plots
from .commands import MORE_TRIALS, range_words, study_command, tune_command
from .conclusions import cost_words, listed
from .document import Comparable, Completeness, Document, Rank, Row
from .files import REPORT, TUNING
from .spread import mean_words
from .wording import assignments, carry_over, head_facts

OVERFITTED = 2.0
"""Standard deviations by which V of the objective may lie below that of other draws."""


class Judged(Struct):
    """A candidate on the whole protocol and, if a worst case was searched for, as far as one was found.

    ``worst_cost`` is V with what was found; ``broken`` are the requirements that fail or are not judged in the one or
    the other, and ``reasons`` says why, one sentence for each requirement. From then on, the objective has the failing
    cases, which the ``commands`` repeat.
    """

    trial: Natural
    after: Natural
    cost: NonNegative | None
    worst_cost: NonNegative | None
    broken: tuple[str, ...]
    commands: tuple[str, ...]
    reasons: tuple[str, ...] = ()


class Best(Struct):
    """The candidate that is best of those that hold A1 to A3, and the figures that show whether
    its V depends on the draws it was tuned with.

    ``held_out`` is V of the objective's performance cases with other draws; ``seeds`` V of the whole protocol with
    other seeds; ``strict`` V of the protocol strict, ``strict_broken`` what fails there, and ``strict_not_judged``
    what is not judged there.
    """

    trial: Trial
    cost: NonNegative | None
    held_out: Statistic
    seeds: Statistic
    strict: NonNegative | None
    strict_broken: tuple[str, ...]
    strict_not_judged: tuple[str, ...] = ()

    @property
    def overfitted(self) -> bool:
        """Whether the objective's V is lower than other draws explain."""
        mean, deviation = self.held_out.mean, self.held_out.deviation
        if mean is None or deviation is None or self.trial.cost is None:
            return True
        return self.trial.cost < mean - OVERFITTED * deviation


class Tuning(Document, Comparable, kw_only=True):
    """The parameters of a controller that a search found; shows itself in a notebook.

    ``trials`` are in the order they were tried, the first one at the values that the search began with; their
    objectives count the cases that were added up to the end. ``best`` is None if none of the candidates that were tried
    on the whole protocol, ``judged``, holds A1 to A3. ``importance`` is the share of each parameter in how the
    objective varies.
    """

    FILE: ClassVar[str] = TUNING
    SCHEMA: ClassVar[str] = "flexible-manipulator-tuning/2"
    KIND: ClassVar[str] = "Tunings, the best candidate"
    DERIVED: ClassVar[tuple[str, ...]] = (REPORT,)

    objective: str
    sampler: str
    search_seed: Natural
    robust: Natural
    vary: dict[str, Range]
    trials: tuple[Trial, ...]
    judged: tuple[Judged, ...]
    best: Best | None
    importance: dict[str, NonNegative]

    def _problem(self) -> str:
        if any(trial.values.keys() != self.vary.keys() for trial in self.trials):
            return "a trial has other parameters than those that vary"
        return ""

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        if self.best is None:
            return "incomplete"
        return "not judged" if self.best.strict_not_judged else "complete"

    @property
    def parameters(self) -> dict[str, Finite]:
        """The best candidate's values by FMI name; those the search began with if there is none."""
        return self.best.trial.values if self.best is not None else self.trials[0].values

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        if self.best is None or self.best.cost is None:
            return Rank(holds=False, reason="no candidate holds A1-A3")
        return Rank(self.best.cost, not self.best.strict_broken)

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """V of the best candidate, with other seeds and on the strict list."""
        best = self.best
        seeds = Value(None) if best is None else Value(best.seeds.mean, best.seeds.deviation)
        return (
            (Column("trials"), len(self.trials)),
            (Column("V", best="smallest"), self.V),
            (Column("V, other seeds"), seeds),
            (Column("V, strict list"), None if best is None else best.strict),
            (Column("fails there"), "-" if best is None else ", ".join(best.strict_broken) or "none"),
            (Column("values"), "-" if best is None else assignments(best.trial.values)),
        )

    def summary(self) -> Summary:
        """The best candidate beside what the search began with, and its V with other draws."""
        parts: list[Part] = [_parameters(self)]
        parts += [_best(self)] if self.best else [_nearest(self)]
        return Summary(f"Tuning of {self.controller.file}", self._kicker, (*parts, *map(Note, tuning_remarks(self))))

    def page(self) -> Page:
        """The report: how the search went, which parameters matter, what V costs in stability."""
        best, first = self.best, self.trials[0]
        marks = (("target", self.rules.cost.target), *((("start", first.cost),) if first.cost is not None else ()))
        sentence = "In the whole protocol. Start: in the objective, at the values the search began with."
        if best is None:
            sentence = "None of the candidates that were judged holds A1 to A3."
        headline = Headline("Cost V of the best", None if best is None else best.cost, marks, sentence)
        summary: tuple[Part, ...] = (
            *map(Note, tuning_remarks(self)),
            Beside(((headline,), (_best(self) if best else _nearest(self),))),
            _parameters(self),
            Facts("This search", tuple(_facts(self))),
        )
        panels = (
            Panel("summary", "Summary", summary),
            Panel("history", "History", (self._history,)),
            Panel("parameters", "Parameters", self._by_parameter),
            Panel("trade", "V and stability", (self._trade,)),
            Panel("judged", "Judged candidates", (_judged(self), _added(self))),
        )
        return Page(f"Tuning of {self.controller.file}", self._kicker, panels, self.conclusion())

    def conclusion(self) -> Conclusion:
        """Whether a candidate holds A1 to A3, its V beside that of the start, and what speaks against it."""
        best, judged = self.best, Link("see the judged candidates", panel="judged")
        if best is None:
            ranges = (range_words(name, span.low, span.high, span.log) for name, span in self.vary.items())
            steps = [judged, Link("tune again with more trials", tune_command(self.head, *MORE_TRIALS, ranges=ranges))]
            return conclusions.conclusion(False, (_none_holds(self),), steps)
        marks = {"start": self.trials[0].cost, "target": self.rules.cost.target}
        words = (
            f"The best of {len(self.trials)} trials, number {best.trial.number}, holds A1 to A3 in {self.protocol}",
            cost_words(f"V {number(best.cost)}", marks),
            f"on the strict list {listed(best.strict_broken)} fail{'s' * (len(best.strict_broken) == 1)}"
            if best.strict_broken
            else f"V {number(best.strict)} on the strict list",
            "overfitted to the draws it was tuned with" if best.overfitted else "",
        )
        steps = [
            Link("evaluate the best", study_command(self.head, "evaluate", parameters=best.trial.values)),
            Link("search for its worst case", study_command(self.head, "robustness", parameters=best.trial.values)),
            judged,
        ]
        return conclusions.conclusion(not best.strict_broken, words, steps)

    @property
    def _best_trial(self) -> Trial | None:
        return None if self.best is None else self.best.trial

    @property
    def _history(self) -> Part:
        added = {candidate.after: len(candidate.commands) for candidate in self.judged if candidate.commands}
        return tuning_plots.history(self.trials, self._best_trial, self.rules.cost.target, self.objective, added)

    @property
    def _by_parameter(self) -> tuple[Part, ...]:
        """Which parameters matter, and where the good candidates lie."""
        none = Note(
            "Of one parameter, or of candidates that all came to the same, there is no importance.", warning=False
        )
        slices = (
            (name, (tuning_plots.by_parameter(name, place, span, self.trials, self._best_trial),))
            for place, (name, span) in enumerate(self.vary.items())
        )
        return tuning_plots.importance(self.importance) or none, Choice("slice", "Parameter", tuple(slices))

    @property
    def _trade(self) -> Part:
        plot = tuning_plots.trade(self.trials, self._best_trial, self.rules.cost.target)
        return plot or Note("No candidate has both a cost and a limit cycle's amplitude.", warning=False)

    @property
    def _kicker(self) -> str:
        return (
            f"{self.benchmark}, {len(self.trials)} trials ({self.sampler}) in the protocol {self.objective}, "
            f"{len(self.judged)} candidate{'s' * (len(self.judged) != 1)} in {self.protocol}"
        )

    def __repr__(self) -> str:
        return f"Tuning({self.controller.file}, {len(self.trials)} trials: {best_words(self)})"


def best_words(tuning: Tuning) -> str:
    """The best candidate and its V."""
    if tuning.best is None:
        return "none holds A1-A3"
    return f"V = {number(tuning.best.cost)} with {assignments(tuning.best.trial.values)}"


def _parameters(tuning: Tuning) -> Table:
    """What varies: name, value at the start, value of the best, range, and importance."""
    best, first = tuning.best, tuning.trials[0].values
    rows = tuple(
        (
            name,
            Value(first[name], given=True),
            None if best is None else Value(best.trial.values[name], given=True),
            f"{span.low:g} to {span.high:g}{' log' if span.log else ''}",
            tuning.importance.get(name),
        )
        for name, span in tuning.vary.items()
    )
    columns = tuple(map(Column, ("parameter", "start", "best", "range", "importance")))
    return Table("Parameters", columns, rows, caption="In the units of the FMU. best.toml holds the best values.")


def _best(tuning: Tuning) -> Table:
    """Where V of the best candidate was measured, and what it is there."""
    best = tuning.best
    assert best is not None
    words = [f"{', '.join(best.strict_broken)} fails"] if best.strict_broken else []
    words += [f"{', '.join(best.strict_not_judged)} not judged"] if best.strict_not_judged else []
    passed = False if best.strict_broken else None if best.strict_not_judged else True
    hold = VerdictCell(True, "hold")
    rows: tuple[tuple[Cell, ...], ...] = (
        (f"{tuning.protocol}, seed {tuning.seed}", best.cost, hold),
        (f"{tuning.protocol}, other seeds", Value(best.seeds.mean, best.seeds.deviation), None),
        ("strict list", best.strict, VerdictCell(passed, ", ".join(words) or "hold")),
        (f"{tuning.objective}, as it was tuned", best.trial.cost, hold),
        (f"{tuning.objective}, other draws", Value(best.held_out.mean, best.held_out.deviation), None),
    )
    caption = (
        "Mean ± standard deviation where there are several. If V as it was tuned is far below V with other draws, the "
        "candidate fits the draws it was tuned with."
    )
    return Table("V of the best candidate", (Column("where"), Column("V"), Column("A1-A3")), rows, caption=caption)


NEAREST = 3
"""Candidates that are listed where none holds A1 to A3."""


def _nearest(tuning: Tuning) -> Table:
    """The candidates of the lowest objectives, and what failed, where none holds A1 to A3."""
    judged = {candidate.trial: candidate for candidate in tuning.judged}
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            trial.number,
            trial.objective,
            trial.cost,
            failure_words(trial) or "none",
            ", ".join(judged[trial.number].broken) or "none" if trial.number in judged else "not tried",
            assignments(trial.values),
        )
        for trial in _ranked(tuning)[:NEAREST]
    )
    columns = tuple(map(Column, ("trial", "objective", "V", f"fails in {tuning.objective}", f"in {tuning.protocol}")))
    caption = "In brackets: the largest limit cycle relative to what A3 allows."
    return Table("Nearest to holding A1 to A3", (*columns, Column("values", minor=True)), rows, caption=caption)


def _ranked(tuning: Tuning) -> list[Trial]:
    """The trials that were not cut short, that of the lowest objective first."""
    return sorted((trial for trial in tuning.trials if not trial.cut_short), key=lambda trial: trial.objective)


def failure_words(candidate: Trial) -> str:
    """What failed in a trial, and by how much, such as ``A2 (1.75 times the limit)``; empty if nothing did."""
    sizes = {name: "unstable" if x is None else f"{number(x)} times the limit" for name, x in candidate.fails.items()}
    words = [f"{name} ({size})" for name, size in sizes.items()]
    return candidate.message or ", ".join(words)


def _nearest_words(tuning: Tuning) -> str:
    """What came closest to holding A1 to A3, and why it does not hold."""
    judged = {candidate.trial: candidate for candidate in tuning.judged}
    nearest = next(iter(_ranked(tuning)), None)
    if nearest is None:
        return ""
    lead = f"Nearest: trial {nearest.number}, objective {number(nearest.objective)}, V = {number(nearest.cost)}."
    told = [f"It fails in {tuning.objective}: {words}."] if (words := failure_words(nearest)) else []
    if nearest.number in judged:
        told += [f"{reason}." for reason in judged[nearest.number].reasons]
    return " ".join((lead, *told))


def _judged(tuning: Tuning) -> Table:
    """The candidates that were tried on the whole protocol."""
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            row.trial,
            row.after,
            row.cost,
            row.worst_cost,
            VerdictCell(not row.broken, ", ".join(row.broken) or "none"),
            assignments(tuning.trials[row.trial].values),
        )
        for row in tuning.judged
    )
    columns = tuple(map(Column, ("trial", "after trials", "V", "V found", "fails", "values")))
    caption = "V found: with the largest values of a search for the worst case, where one was made."
    return Table("Candidates in the whole protocol", columns, rows, caption=caption)


def _added(tuning: Tuning) -> Part:
    """The cases that were added to the objective, as commands."""
    pairs = [
        (f"after {row.after} trials, from trial {row.trial}", command)
        for row in tuning.judged
        for command in row.commands
    ]
    if not pairs:
        return Note("Nothing was added to the objective: no candidate failed.", warning=False)
    return Commands("what was added to the objective", tuple(pairs))


def _facts(tuning: Tuning) -> Iterator[tuple[str, str]]:
    """How the answer was obtained."""
    robust = f", and a search with a budget of {tuning.robust} whole cases" if tuning.robust else ""
    yield from head_facts(tuning.head)
    yield "Objective", f"protocol {tuning.objective}"
    yield "Candidates judged", f"{len(tuning.judged)}, in the protocol {tuning.protocol}, seed {tuning.seed}{robust}"
    yield "Trials", f"{len(tuning.trials)}, {sum(trial.cut_short for trial in tuning.trials)} of them cut short"
    yield "Sampler", f"{tuning.sampler}, seed {tuning.search_seed}"


def _none_holds(tuning: Tuning) -> str:
    """That none of the candidates is one that could be used."""
    count = len(tuning.judged)
    tried = f"None of the {count} candidates that were" if count > 1 else "The candidate that was"
    return f"{tried} tried on the whole protocol {'holds' if count > 1 else 'does not hold'} A1-A3"


def tuning_remarks(tuning: Tuning) -> list[str]:
    """What a reader must know of a tuning."""
    best, remarks = tuning.best, carry_over(tuning.head)
    if best is None:
        return [f"{_none_holds(tuning)}.", *filter(None, [_nearest_words(tuning)])]
    if best.overfitted:
        tuned, others = number(best.trial.cost), mean_words(best.held_out)
        remarks.append(
            f"Overfitted: V of the objective is {tuned}, but {others} with other draws of systems and noise."
        )
    if best.strict_broken:
        remarks.append(
            f"On the strict list {', '.join(best.strict_broken)} fails; the candidates were "
            f"{'tried on' if tuning.robust else 'not tried with'} the worst cases of a search."
        )
    ends = [name for name, span in tuning.vary.items() if not NEAR < span.place(best.trial.values[name]) < 1.0 - NEAR]
    if ends:
        remarks.append(f"At an end of its range: {', '.join(ends)}.")
    return remarks


NEAR = 1e-3
"""Part of a range that is its end."""
