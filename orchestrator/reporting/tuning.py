"""The answer of a tuning: what ``tuning.json`` holds, and its words."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from ..benchmark.results import ControllerRecord, PlantRecord, Rules
from ..benchmark.spread import Statistic
from ..codec import Finite, Natural, NonNegative, Struct
from ..search.candidates import Range, Trial
from .documents import Document, rules_problem
from .files import TUNING, write_text
from .spread import mean_words
from .wording import assignments, number

OVERFITTED = 2.0
"""Standard deviations by which V of the objective may lie below that of other draws."""


class Judged(Struct):
    """A candidate on the whole protocol and, if a worst case was searched for, as far as one was found.

    ``worst_cost`` is V with what was found; ``broken`` are the requirements that fail or are not judged in the one or
    the other; the objective has had the failing cases, which the ``commands`` repeat, from then on.
    """

    trial: Natural
    after: Natural
    cost: NonNegative | None
    worst_cost: NonNegative | None
    broken: tuple[str, ...]
    commands: tuple[str, ...]


class Best(Struct):
    """The candidate that is best of those that hold A1 to A3, and what tells whether that is luck.

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


class Tuning(Document, kw_only=True):
    """The parameters of a controller that a search found; shows itself in a notebook.

    ``trials`` are in the order they were tried, the first one at the values that the search began with; their
    objectives count the cases that were added up to the end. ``best`` is None if none of the candidates that were tried
    on the whole protocol, ``judged``, holds A1 to A3. ``importance`` is the share of each parameter in how the
    objective varies.
    """

    FILE: ClassVar[str] = TUNING
    SCHEMA: ClassVar[str] = "flexible-manipulator-tuning/1"

    benchmark: str
    protocol: str
    objective: str
    seed: Natural
    sampler: str
    search_seed: Natural
    robust: Natural
    vary: dict[str, Range]
    trials: tuple[Trial, ...]
    judged: tuple[Judged, ...]
    best: Best | None
    importance: dict[str, NonNegative]
    rules: Rules
    controller: ControllerRecord
    plant: PlantRecord
    wall_time: NonNegative

    def _problem(self) -> str:
        if any(trial.values.keys() != self.vary.keys() for trial in self.trials):
            return "a trial has other parameters than those that vary"
        return rules_problem(self.rules)

    @property
    def parameters(self) -> dict[str, Finite]:
        """The best candidate's values by FMI name; those the search began with if there is none."""
        return self.best.trial.values if self.best is not None else self.trials[0].values

    def report(self, file: str | Path) -> Path:
        """Write the report, one HTML page that needs no network."""
        from .tune_page import tune_html

        write_text(Path(file), tune_html(self))
        return Path(file)

    def _repr_html_(self) -> str:
        from .fragments import tuning_fragment

        return tuning_fragment(self)

    def __repr__(self) -> str:
        return f"Tuning({self.controller.file}, {len(self.trials)} trials: {best_words(self)})"


def best_words(found: Tuning) -> str:
    """The best candidate and its V."""
    if found.best is None:
        return "none holds A1-A3"
    return f"V = {number(found.best.cost)} with {assignments(found.best.trial.values)}"


def parameter_rows(found: Tuning) -> list[tuple[str, ...]]:
    """What varies: name, value at the start, value of the best, range, and importance."""
    best, first = found.best, found.trials[0].values
    return [
        (
            name,
            f"{first[name]:g}",
            "-" if best is None else f"{best.trial.values[name]:g}",
            f"{own.low:g} to {own.high:g}{' log' if own.log else ''}",
            number(found.importance.get(name)),
        )
        for name, own in found.vary.items()
    ]


def best_rows(found: Tuning) -> list[tuple[str, str]]:
    """Where V of the best candidate was measured, and what it is there; nothing if there is none."""
    best = found.best
    if best is None:
        return []
    words = [f"{', '.join(best.strict_broken)} fails"] if best.strict_broken else []
    words += [f"{', '.join(best.strict_not_judged)} not judged"] if best.strict_not_judged else []
    strict = ", ".join(words) or "A1-A3 hold"
    return [
        (f"{found.protocol}, seed {found.seed}", f"{number(best.cost)}, A1-A3 hold"),
        (f"{found.protocol}, other seeds", mean_words(best.seeds)),
        ("strict list", f"{number(best.strict)}, {strict}"),
        (f"{found.objective}, as it was tuned", number(best.trial.cost)),
        (f"{found.objective}, other draws", mean_words(best.held_out)),
    ]


def tuning_remarks(found: Tuning) -> list[str]:
    """What a reader must know of a tuning."""
    best, remarks = found.best, []
    if best is None:
        return [f"None of the {len(found.judged)} candidates that were tried on the whole protocol holds A1-A3."]
    if best.overfitted:
        own, others = number(best.trial.cost), mean_words(best.held_out)
        remarks.append(f"Overfitted: V of the objective is {own}, but {others} with other draws of systems and noise.")
    if best.strict_broken:
        remarks.append(
            f"On the strict list {', '.join(best.strict_broken)} fails; the candidates were "
            f"{'tried on' if found.robust else 'not tried with'} the worst cases of a search."
        )
    ends = [name for name, own in found.vary.items() if not NEAR < own.place(best.trial.values[name]) < 1.0 - NEAR]
    if ends:
        remarks.append(f"At an end of its range: {', '.join(ends)}.")
    return remarks


NEAR = 1e-3
"""Part of a range that is its end."""
