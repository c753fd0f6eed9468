"""The answer of a sweep: what ``sweep.json`` holds, its table and its picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, ClassVar

from ..codec import Finite
from ..errors import InputError
from ..search.candidates import Trial
from ..views.export import csv_text
from ..views.plot import Axis, Heat, Layer, Level, Line, Plot, Scatter
from ..views.table import Cell, Column, Conclusion, Facts, Link, Note, Part, Summary, Table, Value, VerdictCell
from ..views.units import number
from . import conclusions, files
from .commands import range_words, study_command, tune_command
from .conclusions import cost_words
from .document import Comparable, Completeness, Document, Rank, Row
from .wording import assignments, carry_over, head_facts

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


CSV, SVG = "sweep.csv", "sweep.svg"
"""What shows a sweep beside its report."""


FAILS = "A1-A3 fail"

DECADE = 10.0
"""Ratio of the last to the first value from which on a scale is logarithmic."""


class Sweep(Document, Comparable, kw_only=True):
    """V and stability over a grid of parameter values; shows itself in a notebook.

    ``values`` are those of each parameter; ``trials`` all their combinations, in which the last parameter changes
    fastest.
    """

    FILE: ClassVar[str] = files.SWEEP
    SCHEMA: ClassVar[str] = "flexible-manipulator-sweep/2"
    KIND: ClassVar[str] = "Sweeps, the best combination"
    DERIVED: ClassVar[tuple[str, ...]] = (files.REPORT, CSV, SVG)

    values: dict[str, tuple[Finite, ...]]
    trials: tuple[Trial, ...]

    def _problem(self) -> str:
        if len(self.trials) != math.prod(map(len, self.values.values())):
            return "its trials are not the combinations of its values"
        if any(trial.values.keys() != self.values.keys() for trial in self.trials):
            return "a trial has other parameters than those that vary"
        return ""

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        if not all(trial.judged for trial in self.trials):
            return "not judged"
        return "incomplete" if any(trial.message for trial in self.trials) else "complete"

    @property
    def best(self) -> Trial | None:
        """The combination of the smallest V of those that hold A1 to A3; None if none does."""
        holding = [trial for trial in self.trials if trial.holds and trial.cost is not None]
        return min(holding, key=lambda trial: trial.objective, default=None)

    def columns(self) -> dict[str, list[Any]]:
        """One list per column, one element per combination: the values, V, ``cycle`` (the largest limit cycle relative
        to what A3 allows), whether A1 to A3 hold, and what failed. None where there is no such figure."""
        table: dict[str, list[Any]] = {name: [trial.values[name] for trial in self.trials] for name in self.values}
        fields = {"V": "cost", "cycle": "cycle", "holds": "holds", "message": "message"}
        return table | {name: [getattr(trial, field) for trial in self.trials] for name, field in fields.items()}

    def to_pandas(self) -> pandas.DataFrame:
        """The :meth:`columns`. Needs the package pandas (the extra ``pandas``)."""
        from pandas import DataFrame  # optional

        return DataFrame(self.columns())

    def csv(self) -> str:
        """The same as CSV."""
        table = self.columns()
        return csv_text(table, zip(*table.values(), strict=True))

    def plot(self, figure: Figure | None = None) -> Figure:
        """V over the values of one parameter, or as a map over those of two, in ``figure`` or a new one.

        Raises :class:`InputError` if more than two parameters have several values.
        """
        if len(self.varied) > 2:
            message = f"{len(self.varied)} parameters vary ({', '.join(self.varied)}): a picture shows one or two."
            raise InputError(message, "no-picture")
        from ..views import drawing  # Matplotlib takes as long to load as the rest of a command

        return drawing.figure(self._line() if len(self.varied) == 1 else self._map(), into=figure)

    @property
    def varied(self) -> tuple[str, ...]:
        """The parameters that have several values; the first one if none has."""
        return tuple(name for name, values in self.values.items() if len(values) > 1) or tuple(self.values)[:1]

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        reason = "" if self.best is not None else "no combination has a V and holds A1-A3"
        return Rank(None if self.best is None else self.best.cost, self.best is not None, reason)

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """The best combination."""
        cells: list[tuple[Column, Cell]] = [(Column("combinations"), len(self.trials))]
        cells.append((Column("V", best="smallest"), self.V))
        return *cells, (Column("values"), "-" if self.best is None else assignments(self.best.values))

    def summary(self) -> Summary:
        """The combinations, and the best of them."""
        parts: list[Part] = [Facts("This sweep", tuple(head_facts(self.head))), self.table()]
        parts.append(Note(f"Best: {smallest_words(self)}.", warning=self.best is None))
        parts += [self._line()] if len(self.varied) == 1 else [self._map()] if len(self.varied) == 2 else []
        kicker = f"{self.benchmark}, protocol {self.protocol}, seed {self.seed}, {len(self.trials)} combinations"
        return Summary(self.controller.file, kicker, (*parts, *map(Note, carry_over(self.head))))

    def table(self) -> Table:
        """Every combination: the values, V, the limit cycle relative to what A3 allows, and whether A1 to A3 hold."""
        rows = tuple(
            (
                *(Value(value, given=True) for value in trial.values.values()),
                trial.cost,
                trial.cycle,
                trial.message or VerdictCell(trial.holds, "hold" if trial.holds else "fail"),
            )
            for trial in self.trials
        )
        columns = (*map(Column, self.values), Column("V", best="smallest"), Column("cycle"), Column("A1-A3"))
        failing = frozenset(place for place, trial in enumerate(self.trials) if not trial.holds)
        return Table("Every combination", columns, rows, outside=failing)

    def conclusion(self) -> Conclusion:
        """The best combination, and how many hold A1 to A3."""
        best, holding = self.best, sum(trial.holds for trial in self.trials)
        count = f"{holding} of {len(self.trials)} combinations hold A1 to A3"
        if best is None:
            steps = [Link("search between the values", self._tune)]
            return conclusions.conclusion(False, (f"{count}, and none of these has a V",), steps)
        total = cost_words(f"V {number(best.cost)}", {"target": self.rules.cost.target})
        steps = [
            Link("evaluate the best", study_command(self.head, "evaluate", parameters=best.values)),
            Link("search for its worst case", study_command(self.head, "robustness", parameters=best.values)),
            Link("search between the values", self._tune),
        ]
        return conclusions.conclusion(True, (f"{count}; the best has {total}, with {assignments(best.values)}",), steps)

    @property
    def _tune(self) -> str:
        """The command that searches between the smallest and the largest value of each parameter that varies."""
        ranges = (range_words(name, min(self.values[name]), max(self.values[name])) for name in self.varied)
        return tune_command(self.head, ranges=ranges)

    def _line(self) -> Plot:
        """V over the values of one parameter; where one has no V, a line."""
        (name,) = self.varied
        order = sorted(self.trials, key=lambda trial: trial.values[name])
        x, y = [trial.values[name] for trial in order], [trial.cost for trial in order]
        failing = [place for place, trial in enumerate(order) if not trial.holds]
        series: list[Line | Scatter] = [Line("V", x, y, symbol="circle")]
        if failing:
            points = [x[place] for place in failing], [y[place] for place in failing]
            series.append(Scatter(FAILS, *points, "bad", "cross", 10.0))
        without = (value for value, V in zip(x, y, strict=True) if V is None)
        target = self.rules.cost.target
        levels = Level(target, f"target: {target:g}"), *(
            Level(value, "no V", upright=True, colour="bad", dash="dotted") for value in without
        )  # fmt: skip
        axis = Axis(name, logarithmic=0.0 < x[0] * DECADE <= x[-1])
        return Plot("sweep-plot", f"V over {name}", axis, Axis("V"), tuple(series), levels)

    def _map(self) -> Heat:
        """V over the values of two parameters, the first one upwards."""
        up, right = self.varied
        rows, columns = sorted(self.values[up], reverse=True), sorted(self.values[right])
        trials = {(trial.values[up], trial.values[right]): trial for trial in self.trials}
        places = [(row, column) for row in rows for column in columns]
        costs = tuple(trials[place].cost for place in places)
        failing = frozenset(number for number, place in enumerate(places) if not trials[place].holds)
        layer = Layer(f"V (× where {FAILS})", costs, "V", target=self.rules.cost.target, marked=failing)
        x, y = Axis(right, names=tuple(map(_short, columns))), Axis(up, names=tuple(map(_short, rows)))
        cells = tuple(f"{up} = {row:g}, {right} = {column:g}" for row, column in places)
        text = f"over {right} to the right and {up} upwards; × where {FAILS}."
        return Heat("sweep-map", f"V over {right} and {up}", x, y, (layer,), cells, text)

    def __repr__(self) -> str:
        return f"Sweep({self.controller.file}, {len(self.trials)} combinations: {smallest_words(self)})"


def _short(value: float) -> str:
    return f"{value:g}"


def smallest_words(sweep: Sweep) -> str:
    """The best combination and its V."""
    best = sweep.best
    if best is None:
        return "no combination has a V and holds A1-A3"
    return f"V = {number(best.cost)} with {assignments(best.values)}"
