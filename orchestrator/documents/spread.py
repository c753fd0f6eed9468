"""The results of one controller with several seeds: what ``spread.json`` holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import ClassVar

from msgspec.structs import asdict

from ..benchmark.spread import Holding, SeedScore, Statistic, paired, seed_score, summary
from ..benchmark.tally import reason
from ..codec import Natural
from ..views.plot import Axis, Level, Line, Plot, Scatter
from ..views.table import (
    Cell,
    Column,
    Conclusion,
    Facts,
    Link,
    Note,
    Part,
    Quantity,
    Summary,
    Table,
    Value,
    VerdictCell,
)
from ..views.units import NONE, SHOWN, Unit, number
from . import conclusions
from .commands import again, case_command, setting, study_command, tune_command
from .conclusions import cost_words, decisive, overall, share_words, verdict_words
from .document import Comparable, Completeness, Document, Rank, Row
from .files import REPORT, SPREAD
from .head import Head
from .results import Results
from .scorecard import criterion_column
from .wording import Reason, carry_over, head_facts, reason_notes, reason_text

FAILS = "a requirement is not met"
"""What is marked in a plot over seeds."""


class Spread(Document, Comparable, kw_only=True):
    """How good a controller is with several seeds; shows itself in a notebook. All values are in SI units.

    ``cost`` and ``criteria`` have ``mean``, ``deviation`` (sample standard deviation), ``smallest``, ``largest``, and
    the seeds ``without`` a value: all of ``seeds``, the evaluations in which every case was simulated. Those of
    ``unfinished`` do not count. ``requirements`` say with how many seeds they are met, of those that they were judged
    with, in ``seeds`` or in ``incomplete``, the evaluations in which a case was not simulated.
    """

    FILE: ClassVar[str] = SPREAD
    SCHEMA: ClassVar[str] = "flexible-manipulator-spread/2"
    DERIVED: ClassVar[tuple[str, ...]] = (REPORT,)
    KIND: ClassVar[str] = "Several seeds, mean ± standard deviation"

    cost: Statistic
    criteria: dict[str, Statistic]
    requirements: dict[str, Holding]
    seeds: tuple[SeedScore, ...]
    unfinished: tuple[Natural, ...]
    incomplete: tuple[SeedScore, ...] = ()

    def passed(self, name: str) -> bool | None:
        """Whether a requirement is met: False if not with some seed, None if it is not judged with one."""
        held = self.requirements[name]
        if held.seeds < held.of:
            return False
        return True if held.of == len(self.seeds) + len(self.unfinished) > 0 else None

    def worst(self, name: str) -> SeedScore | None:
        """The first seed that a requirement is not met with; if it is met with all, the first it is not judged with."""
        scores = [score for score in (*self.seeds, *self.incomplete) if not score.requirements[name]]
        return min(scores, key=lambda score: score.requirements[name] is None, default=None)

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        run = self.incomplete
        if any("lost" in score.ended or any(t.interrupted for t in score.tallies.values()) for score in run):
            return "not judged"
        missing = {*self.unfinished} - {score.seed for score in run}
        return "incomplete" if missing or any(score.ended for score in run) else "complete"

    def _problem(self) -> str:
        names = set(self.rules.criteria)
        if any(set(score.criteria) != names for score in (*self.seeds, *self.incomplete)):
            return "its seeds have other criteria than its rules"
        same = asdict(summary(self.rules, self.seeds, self.incomplete)).items() <= asdict(self).items()
        return "" if same else "its statistics are not those of its seeds"

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        reason = "" if self.cost.mean is not None else "no mean of V: an evaluation is unstable or incomplete"
        return Rank(self.cost.mean, all(self.passed(name) for name in self.requirements), reason)

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """Mean and standard deviation of V and the criteria, with how many seeds the requirements are met, and V minus
        that of the first, over the seeds in common."""
        cells: list[tuple[Column, Cell]] = [(Column("seeds"), len(self.seeds))]
        cells.append((Column("V", best="smallest"), Value(self.cost.mean, self.cost.deviation)))
        for name, spec in self.rules.criteria.items():
            statistic = self.criteria[name]
            cells.append((criterion_column(name, spec.unit), Value(statistic.mean, statistic.deviation)))
        for name, held in self.requirements.items():
            cells.append((Column(name), VerdictCell(self.passed(name), f"{held.seeds}/{held.of}")))
        difference = paired(self.seeds, first.seeds) if isinstance(first, Spread) else None
        better = "-"
        if difference is not None:
            of = len(difference.seeds)
            better = f"{mean_words(difference.difference)}, better with {difference.better} of {of} seeds"
        return *cells, (Column("V minus that of the first"), better)

    def summary(self) -> Summary:
        """Mean, standard deviation and range of V and the criteria, and with how many seeds the requirements hold."""
        seeds = ", ".join(str(score.seed) for score in self.seeds) or "none"
        parts: list[Part] = [Facts("This spread", tuple(head_facts(self.head))), _statistics(self), _held(self)]
        parts.append(_over_seeds(self))
        parts += [*reason_notes(spread_reasons(self)), *(Note(remark) for remark in spread_remarks(self))]
        return Summary(self.controller.file, f"{self.benchmark}, protocol {self.protocol}, seeds {seeds}", tuple(parts))

    def conclusion(self) -> Conclusion:
        """With how many seeds the requirements are met, V over the seeds, and what costs most."""
        passed = {name: self.passed(name) for name in self.requirements}
        verdict, means = overall(passed), {name: criterion.mean for name, criterion in self.criteria.items()}
        reasons = list(spread_reasons(self))
        first = next((name for name in decisive(passed)), "")
        why = ""
        if verdict is True:
            why = f" with all of {len(self.seeds)} seeds"
        elif held := self.requirements.get(first):
            why = f", {first} with {held.of - held.seeds} of {held.of} seeds" if verdict is False else ""
        total = cost_words(f"V {mean_words(self.cost)}", {"target": self.rules.cost.target})
        total = "no mean of V" if self.cost.mean is None else total
        words = verdict_words(passed) + why, ", ".join(filter(None, (total, share_words(self.rules, means))))
        steps = [Link("simulate the worst case", reason.command) for reason in reasons if reason.command][:1]
        steps.append(Link("search for the worst case", study_command(self.head, "robustness")))
        steps.append(Link("tune the parameters", tune_command(self.head)))
        return conclusions.conclusion(verdict, words, steps)

    def __repr__(self) -> str:
        return f"Spread({self.controller.file}, {self.protocol}, {len(self.seeds)} seeds: V = {mean_words(self.cost)})"


def spread_of(seeds: Sequence[int], evaluations: Sequence[Results], head: Head) -> Spread:
    """The spread over ``seeds`` of the ``evaluations`` so far, at least one, which differ in their seed alone."""
    scores, incomplete = (
        [
            seed_score(results.head.seed or 0, results.scorecard, results.cases)
            for results in evaluations
            if results.complete is whole
        ]
        for whole in (True, False)
    )
    finished = {score.seed for score in scores}
    return Spread(
        schema=Spread.SCHEMA,
        head=head,
        **asdict(summary(head.rules, scores, incomplete)),
        seeds=tuple(scores),
        unfinished=tuple(seed for seed in seeds if seed not in finished),
        incomplete=tuple(incomplete),
    )


def mean_words(of: Statistic, factor: float = 1.0) -> str:
    """Mean and standard deviation."""
    return f"{number(of.mean, factor)} ± {number(of.deviation, factor)}"


def _statistics(spread: Spread) -> Table:
    columns = ("", "criterion", "mean", "s.d.", "smallest", "largest", "target")
    rows: list[tuple[Cell, ...]] = []
    for name, spec in spread.rules.criteria.items():
        unit = SHOWN[spec.unit]
        rows.append((name, Quantity(spec.title, unit), *_row(spread.criteria[name], spec.target, unit)))
    rows.append(("V", "Cost, eq. (15)", *_row(spread.cost, spread.rules.cost.target, NONE)))
    shown = tuple(Column(name, minor=name == "criterion") for name in columns)
    return Table("Over the seeds", shown, tuple(rows))


def _row(of: Statistic, target: float, unit: Unit) -> tuple[Value, ...]:
    return tuple(Value(value, unit=unit) for value in (of.mean, of.deviation, of.smallest, of.largest, target))


def _over_seeds(spread: Spread) -> Plot:
    """V over the seeds, those marked with which a requirement is not met."""
    scores = sorted(spread.seeds, key=lambda score: score.seed)
    x, y = [float(score.seed) for score in scores], [score.cost for score in scores]
    failing = [place for place, score in enumerate(scores) if False in score.requirements.values()]
    marked = Scatter(FAILS, [x[place] for place in failing], [y[place] for place in failing], "bad", "diamond", 14.0)
    series = (Line("V", x, y, symbol="circle"), *((marked,) if failing else ()))
    levels = Level(spread.rules.cost.target, "target"), Level(spread.rules.cost.paper, "paper's PID")
    return Plot("spread-plot", "V over the seeds", Axis("seed"), Axis("V"), series, levels)


def _held(spread: Spread) -> Table:
    rows = tuple(
        (name, VerdictCell(spread.passed(name)), held.seeds, held.of) for name, held in spread.requirements.items()
    )
    columns = (Column("requirement"), Column("verdict"), Column("met with"), Column("of seeds judged"))
    return Table("Requirements over the seeds", columns, rows)


def spread_reasons(spread: Spread) -> Iterator[Reason]:
    """The requirements, by the first seed with which one is not met or not judged."""
    scores, of = (*spread.seeds, *spread.incomplete), len(spread.seeds) + len(spread.unfinished)
    for name in spread.requirements:
        passed, worst = spread.passed(name), spread.worst(name)
        if worst is None:
            continue
        alike = sum(score.requirements[name] is passed for score in scores)
        where = f"with {alike} of {of} seeds ({'first ' if alike > 1 else ''}seed {worst.seed})"
        tally = worst.tallies[name]
        command = case_command(setting(spread.head, worst.seed), tally.first) if tally.failed else ""
        yield Reason(reason_text(name, passed, where, reason(tally)), command, "" if command else again(tally))


def spread_remarks(spread: Spread) -> list[str]:
    """What a reader must know of a spread."""
    sentences = carry_over(spread.head)
    if spread.cost.without:
        seeds = ", ".join(map(str, spread.cost.without))
        sentences.append(f"No V with the seeds {seeds}, where a loop that counts is unstable: so there is no mean.")
    if spread.unfinished:
        seeds = ", ".join(map(str, spread.unfinished))
        sentences.append(f"Not counted for V and B1 to B7, since not every case was simulated: the seeds {seeds}.")
    return sentences
