"""The results of one controller with several seeds: what ``spread.json`` holds."""

from __future__ import annotations

from collections.abc import Sequence
from typing import ClassVar

from msgspec.structs import asdict

from ..benchmark.results import ControllerRecord, PlantRecord, Results, Rules, SampleTimeRecord
from ..benchmark.spread import Holding, SeedScore, Statistic, seed_score, summary
from ..codec import Natural
from .documents import Document, rules_problem
from .files import SPREAD
from .wording import SHOWN, number


class Spread(Document, kw_only=True):
    """How good a controller is with several seeds; shows itself in a notebook. All values are in SI units.

    ``cost`` and ``criteria`` have ``mean``, ``deviation`` (sample standard deviation), ``smallest``, ``largest``, and
    the seeds ``without`` a value: all of ``seeds``, the evaluations in which every case was simulated. Those of
    ``unfinished`` do not count. ``requirements`` say with how many seeds they are met, of those that they were judged
    with, in ``seeds`` or in ``incomplete``, the evaluations in which a case was not simulated.
    """

    FILE: ClassVar[str] = SPREAD
    SCHEMA: ClassVar[str] = "flexible-manipulator-spread/1"

    benchmark: str
    protocol: str
    protocol_file: str
    cost: Statistic
    criteria: dict[str, Statistic]
    requirements: dict[str, Holding]
    seeds: tuple[SeedScore, ...]
    unfinished: tuple[Natural, ...]
    controller: ControllerRecord
    plant: PlantRecord
    rules: Rules
    sample_time: SampleTimeRecord
    incomplete: tuple[SeedScore, ...] = ()

    def passed(self, name: str) -> bool | None:
        """Whether a requirement is met: False if not with some seed, None if it is not judged with one."""
        held = self.requirements[name]
        if held.seeds < held.of:
            return False
        return True if held.of == len(self.seeds) + len(self.unfinished) > 0 else None

    def worst(self, name: str) -> SeedScore | None:
        """The first seed that a requirement is not met with; if it is met with all, the first it is not judged with."""
        found = [score for score in (*self.seeds, *self.incomplete) if not score.requirements[name]]
        return min(found, key=lambda score: score.requirements[name] is None, default=None)

    def _problem(self) -> str:
        names = set(self.rules.criteria)
        if problem := rules_problem(self.rules):
            return problem
        if any(set(score.criteria) != names for score in (*self.seeds, *self.incomplete)):
            return "its seeds have other criteria than its rules"
        same = asdict(summary(self.rules, self.seeds, self.incomplete)).items() <= asdict(self).items()
        return "" if same else "its statistics are not those of its seeds"

    def _repr_html_(self) -> str:
        from .fragments import spread_fragment

        return spread_fragment(self)

    def __repr__(self) -> str:
        return f"Spread({self.controller.file}, {self.protocol}, {len(self.seeds)} seeds: V = {mean_words(self.cost)})"


def spread_of(seeds: Sequence[int], found: Sequence[Results]) -> Spread:
    """The spread over ``seeds`` of the evaluations ``found`` so far, at least one, which differ in their seed alone."""
    first = found[0]
    scores, incomplete = ([seed_score(each) for each in found if each.complete is whole] for whole in (True, False))
    finished = {score.seed for score in scores}
    return Spread(
        schema=Spread.SCHEMA,
        **{name: getattr(first, name) for name in SAME},
        **asdict(summary(first.rules, scores, incomplete)),
        seeds=tuple(scores),
        unfinished=tuple(seed for seed in seeds if seed not in finished),
        incomplete=tuple(incomplete),
    )


SAME = ("benchmark", "protocol", "protocol_file", "controller", "plant", "rules", "sample_time")
"""What evaluations with several seeds have in common."""


def mean_words(of: Statistic, factor: float = 1.0) -> str:
    """Mean and standard deviation."""
    return f"{number(of.mean, factor)} ± {number(of.deviation, factor)}"


def statistic_rows(spread: Spread) -> list[tuple[str, str, tuple[str, ...]]]:
    """Name, title with unit, and mean, standard deviation, smallest, largest value and target of each criterion and of
    V, in the units they are shown in."""
    entries = [
        (name, f"{spec.title} [{SHOWN[spec.unit][1]}]", spread.criteria[name], spec.target, SHOWN[spec.unit][0])
        for name, spec in spread.rules.criteria.items()
    ]
    rows = []
    for name, title, each, target, factor in (
        *entries,
        ("V", "Cost, eq. (15)", spread.cost, spread.rules.cost.target, 1.0),
    ):
        values = (each.mean, each.deviation, each.smallest, each.largest, target)
        rows.append((name, title, tuple(number(value, factor) for value in values)))
    return rows


def spread_remarks(spread: Spread) -> list[str]:
    """What a reader must know of a spread."""
    found = []
    if spread.cost.without:
        seeds = ", ".join(map(str, spread.cost.without))
        found.append(f"No V with the seeds {seeds}, where a loop that counts is unstable: so there is no mean.")
    if spread.unfinished:
        seeds = ", ".join(map(str, spread.unfinished))
        found.append(f"Not counted for V and B1 to B7, since not every case was simulated: the seeds {seeds}.")
    return found
