"""The answer of a search for the worst case: what ``robustness.json`` holds, and its words."""

from __future__ import annotations

from pathlib import Path
from typing import ClassVar

from ..benchmark.results import ControllerRecord, PlantRecord, Rules
from ..codec import Natural, NonNegative
from ..loop.trajectory import Status
from ..search.findings import (
    ConfigurationFound,
    CriterionFound,
    Effect,
    Margin,
    Radius,
    RequirementFound,
    Step,
)
from .documents import Document, rules_problem, unit_problem
from .files import REPORT, ROBUSTNESS, TRAJECTORIES, write_text
from .recording import load as load_recordings
from .wording import SHOWN, number


class Robustness(Document, kw_only=True):
    """The worst case of a controller as far as it was found; shows itself in a notebook. All values are in SI units.

    ``cost`` is V of eq. (15) from the largest values found: a lower bound of the true one. ``simulations`` counts all,
    ``failures`` those that hung or crashed. ``complete`` is False if time ran out. ``cut_short`` names the stages that
    wanted more simulations than their share of the budget: theirs are the best answers of those that they had.
    """

    FILE: ClassVar[str] = ROBUSTNESS
    SCHEMA: ClassVar[str] = "flexible-manipulator-robustness/1"
    DERIVED: ClassVar[tuple[str, ...]] = (REPORT, TRAJECTORIES)

    benchmark: str
    protocol: str
    seed: int
    budget: Natural
    simulations: Natural
    failures: Natural
    complete: bool
    cut_short: tuple[str, ...] = ()
    cost: NonNegative | None
    protocol_cost: NonNegative | None
    criteria: dict[str, CriterionFound]
    requirements: dict[str, RequirementFound]
    margins: dict[str, Margin]
    radius: Radius | None
    configurations: tuple[ConfigurationFound, ...]
    effects: tuple[Effect, ...]
    path: tuple[Step, ...]
    rules: Rules
    controller: ControllerRecord
    plant: PlantRecord
    wall_time: NonNegative

    def _problem(self) -> str:
        if not set(self.criteria) <= set(self.rules.criteria):
            return "it has criteria that no case is measured by"
        if not set(self.requirements) <= {name for test in self.rules.tests for name in test.requirements}:
            return "it has requirements that no case is judged by"
        return rules_problem(self.rules) or unit_problem(entry.unit for entry in self.criteria.values())

    def report(self, file: str | Path, folder: str | Path | None = None) -> Path:
        """Write the report, one HTML page that needs no network; with the trajectories that were recorded in
        ``folder``, where the search was saved.

        Raises :class:`InputError` if they are damaged.
        """
        from .worst_page import worst_html

        write_text(Path(file), worst_html(self, () if folder is None else load_recordings(Path(folder))))
        return Path(file)

    @property
    def broken(self) -> tuple[str, ...]:
        """The requirements that a failure was found of."""
        return tuple(name for name, entry in self.requirements.items() if entry.passed is False)

    def _repr_html_(self) -> str:
        from .fragments import robustness_fragment

        return robustness_fragment(self)

    def __repr__(self) -> str:
        verdict = f"{', '.join(self.broken)} broken" if self.broken else "no requirement broken"
        if unknown := [name for name, entry in self.requirements.items() if entry.passed is None]:
            verdict += f", {', '.join(unknown)} not judged"
        return f"Robustness({self.controller.file}, {self.simulations} simulations: V = {number(self.cost)}, {verdict})"


def verdict_words(found: RequirementFound) -> str:
    """What a requirement came to."""
    if found.passed:
        return f"no failure found; nearest: {found.kind}, {number(found.limit_cycle, 1e6)} µm"
    if found.passed is None:
        return "not judged: no failure found, but simulations were skipped or lost"
    if found.status not in (Status.DONE, Status.UNSTABLE):
        return f"fails: a simulation ended with {found.status.value}"
    cycle = f", {number(found.limit_cycle, 1e6)} µm at {number(found.frequency)} Hz" if found.limit_cycle else ""
    return f"fails: {found.kind}{cycle}, with {found.seeds_failed} of {found.seeds_tried} seeds"


def margin_words(name: str, margin: Margin, short: bool = False) -> str:
    """A margin in the unit it is shown in, with the seeds it was tried with unless ``short``."""
    factor, unit = (1e3, "ms") if name.startswith("delay") else (1.0, "times")
    if margin.value is None:
        return f"{'<' if name.endswith('down') else '>'} {number(margin.limit, factor)} {unit}"
    seeds = "" if short else f" ({margin.seeds_failed} of {margin.seeds_tried} seeds)"
    return f"{number(margin.value, factor)} {unit}{seeds}"


def radius_rows(radius: Radius | None) -> list[tuple[str, str]]:
    """The two factors on the tolerances of Table 1 and their names; none if there is no radius."""
    if radius is None:
        return []
    reaches = {"radius of V": radius.cost, "radius of A1-A3": radius.stability}
    return [
        (name, f"> {radius.limit:g} times" if reach is None else f"{reach:g} times") for name, reach in reaches.items()
    ]


def largest_words(entry: CriterionFound) -> str:
    """The largest value of a criterion in the unit it is shown in."""
    factor, unit = SHOWN[entry.unit]
    value = entry.worst_case.value
    return "unstable" if value is None and entry.worst_case.command else f"{number(value, factor)} {unit}"


def robustness_remarks(found: Robustness) -> list[str]:
    """What a reader must know of a search."""
    remarks = []
    if found.failures:
        remarks.append(f"{found.failures} simulations ended with crashed, timeout or error.")
    if found.cut_short:
        stages = ", ".join(found.cut_short)
        remarks.append(f"The budget of {found.budget} simulations cut short: {stages}.")
    if not found.complete:
        remarks.append("Time ran out: the search is not complete.")
    return remarks
