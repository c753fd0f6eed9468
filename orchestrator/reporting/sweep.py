"""The answer of a sweep: what ``sweep.json`` holds, its table and its picture."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, ClassVar

from ..benchmark.results import ControllerRecord, PlantRecord, Rules
from ..codec import Finite, Natural, NonNegative
from ..errors import InputError
from ..search.candidates import Trial
from . import files
from .documents import Document, rules_problem
from .tables import inert
from .wording import assignments, number

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure


class Sweep(Document, kw_only=True):
    """V and stability over a grid of parameter values; shows itself in a notebook.

    ``values`` are those of each parameter; ``trials`` all their combinations, in which the last parameter changes
    fastest.
    """

    FILE: ClassVar[str] = files.SWEEP
    SCHEMA: ClassVar[str] = "flexible-manipulator-sweep/1"

    benchmark: str
    protocol: str
    seed: Natural
    values: dict[str, tuple[Finite, ...]]
    trials: tuple[Trial, ...]
    rules: Rules
    controller: ControllerRecord
    plant: PlantRecord
    wall_time: NonNegative

    def _problem(self) -> str:
        if len(self.trials) != math.prod(map(len, self.values.values())):
            return "its trials are not the combinations of its values"
        if any(trial.values.keys() != self.values.keys() for trial in self.trials):
            return "a trial has other parameters than those that vary"
        return rules_problem(self.rules)

    @property
    def best(self) -> Trial | None:
        """The combination of the smallest V of those that hold A1 to A3; None if none does."""
        holding = [trial for trial in self.trials if trial.holds and trial.cost is not None]
        return min(holding, key=lambda trial: trial.objective, default=None)

    def columns(self) -> dict[str, list[Any]]:
        """One list per column, one element per combination: the values, V, ``cycle`` (the largest limit cycle relative
        to what A3 allows), whether A1 to A3 hold, and what failed. None where there is no such figure."""
        found: dict[str, list[Any]] = {name: [trial.values[name] for trial in self.trials] for name in self.values}
        fields = {"V": "cost", "cycle": "cycle", "holds": "holds", "message": "message"}
        return found | {name: [getattr(trial, field) for trial in self.trials] for name, field in fields.items()}

    def to_pandas(self) -> pandas.DataFrame:
        """The :meth:`columns`. Needs the package pandas (the extra ``pandas``)."""
        from pandas import DataFrame

        return DataFrame(self.columns())

    def csv(self) -> str:
        """The same as CSV; an apostrophe precedes text that a spreadsheet would run."""
        table = self.columns()
        return files.csv_text(map(inert, table), (map(inert, row) for row in zip(*table.values(), strict=True)))

    def plot(self, figure: Figure | None = None) -> Figure:
        """V over the values of one parameter, or as a map over those of two, in ``figure`` or a new one.

        Raises :class:`InputError` if more than two parameters have several values.
        """
        from .sweep_figure import draw

        if len(self.varied) > 2:
            message = f"{len(self.varied)} parameters vary ({', '.join(self.varied)}): a picture shows one or two."
            raise InputError(message, "no-picture")
        return draw(self, figure)

    @property
    def varied(self) -> tuple[str, ...]:
        """The parameters that have several values; the first one if none has."""
        return tuple(name for name, each in self.values.items() if len(each) > 1) or tuple(self.values)[:1]

    def _repr_html_(self) -> str:
        from .fragments import sweep_fragment

        return sweep_fragment(self)

    def __repr__(self) -> str:
        return f"Sweep({self.controller.file}, {len(self.trials)} combinations: {smallest_words(self)})"


def smallest_words(found: Sweep) -> str:
    """The best combination and its V."""
    best = found.best
    if best is None:
        return "no combination has a V and holds A1-A3"
    return f"V = {number(best.cost)} with {assignments(best.values)}"


COLUMNS = ("V", "cycle", "A1-A3")
"""Headings of :func:`sweep_rows` after the parameters."""


def sweep_rows(found: Sweep) -> list[tuple[str, ...]]:
    """The combinations in words: the values, V, limit cycle relative to what A3 allows, and whether A1 to A3 hold."""
    return [
        (
            *(f"{value:g}" for value in trial.values.values()),
            number(trial.cost),
            number(trial.cycle),
            trial.message or ("hold" if trial.holds else "fail"),
        )
        for trial in found.trials
    ]
