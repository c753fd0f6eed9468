"""The answer of a search for the worst case: what ``robustness.json`` holds, and its words."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar, Literal

from ..codec import Natural, NonNegative
from ..search.findings import (
    ConfigurationFound,
    CriterionSearched,
    Effect,
    Margin,
    PeakFound,
    Radius,
    RequirementSearched,
    Step,
)
from ..views.table import (
    Beside,
    Cell,
    Choice,
    Column,
    Commands,
    Conclusion,
    Facts,
    Link,
    Note,
    Page,
    Panel,
    Part,
    Summary,
    Value,
)
from ..views.units import NONE, SHOWN, number
from . import case_plots, conclusions, worst_page, worst_plots
from .commands import ROBUST, study_command, tune_command
from .comparability import same_controller
from .conclusions import cost_words, costliest, decisive, listed, overall, share_words, verdict_words
from .document import Comparable, Completeness, Document, Rank, Row, unit_problem
from .evaluation import Evaluation
from .files import REPORT, ROBUSTNESS, TRAJECTORIES, write_text
from .recording import Recording, affordable, shortened
from .recording import load as load_recordings
from .report_page import links
from .spread import Spread
from .wording import carry_over, seed_words

SCORECARDS = (Evaluation.KIND, Spread.KIND)
"""What a search stands beside in a comparison."""


NOMINAL_ROWS = 4000
"""Most rows of the nominal arm beside a worst case."""

WITHOUT = Note("This search was made without trajectories.")

NO_MARGINS = Note("The search has not come to margins and radius.")


class Robustness(Document, Comparable, kw_only=True):
    """The worst case of a controller as far as it was found; shows itself in a notebook. All values are in SI units.

    ``cost`` is V of eq. (15) from the largest values found: a lower bound of the true one, and ``starts`` that of each
    independent start of the search. ``budget`` and ``spent`` are simulated time, in whole cases of the longest test.
    ``simulations`` counts all, ``failures`` those that hung or crashed. ``complete`` is False if time ran out.
    ``cut_short`` names the stages that wanted more than their share of the budget: theirs are the best answers of those
    that they had.
    """

    FILE: ClassVar[str] = ROBUSTNESS
    SCHEMA: ClassVar[str] = "flexible-manipulator-robustness/3"
    KIND: ClassVar[str] = "Worst cases found, beside the scorecards"
    DERIVED: ClassVar[tuple[str, ...]] = (REPORT, TRAJECTORIES)

    budget: Natural
    simulations: Natural
    spent: NonNegative
    failures: Natural
    complete: bool
    cut_short: tuple[str, ...] = ()
    cost: NonNegative | None
    protocol_cost: NonNegative | None
    starts: tuple[NonNegative | None, ...] = ()
    criteria: dict[str, CriterionSearched]
    requirements: dict[str, RequirementSearched]
    margins: dict[str, Margin]
    radius: Radius | None
    configurations: tuple[ConfigurationFound, ...]
    effects: tuple[Effect, ...]
    peaks: tuple[PeakFound, ...] = ()
    path: tuple[Step, ...]

    def _problem(self) -> str:
        if not set(self.criteria) <= set(self.rules.criteria):
            return "it has criteria that no case is measured by"
        if not set(self.requirements) <= {name for test in self.rules.tests for name in test.requirements}:
            return "it has requirements that no case is judged by"
        return unit_problem(entry.unit for entry in self.criteria.values())

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        if any(entry.passed is None for entry in self.requirements.values()):
            return "not judged"
        return "complete" if self.complete and not self.failures else "incomplete"

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        reason = "" if self.cost is not None else "no V was found: a case that counts has no value"
        return Rank(self.cost, all(entry.passed for entry in self.requirements.values()), reason)

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """What was found, beside V of the scorecards of the same controller."""
        cards = [
            (name, card) for name, card in others if card.KIND in SCORECARDS and same_controller(card.head, self.head)
        ]
        words = [f"{number(card.V)} ({card.head.protocol}, {seed_words(card.head)})" for _, card in cards]
        cells: list[tuple[Column, Cell]] = [
            (Column("simulations", minor=True), self.simulations),
            (Column("V of the scorecard"), ", ".join(words) or "-"),
            (Column("V", best="smallest"), self.cost),
        ]
        for name in ("B5", "B6", "B7"):
            if name in self.criteria:
                entry = self.criteria[name]
                worst = entry.worst_case
                cell: Cell = "unstable" if worst.value is None and worst.command else Value(worst.value)
                cells.append((Column(f"largest {name}", SHOWN[entry.unit], minor=True), cell))
        cells.append((Column("fails"), ", ".join(self.broken) or "none found"))
        for name, margin in self.margins.items():
            value = worst_page.margin_value(name, margin)
            unit = value.unit or NONE
            best: Literal["smallest", "largest"] = "smallest" if name.endswith("down") else "largest"
            cells.append((Column(name, unit, minor=True, best=best), value))
        radii = worst_page.radius_values(self.radius)
        return *cells, *((Column(name, minor=True, best="largest"), value) for name, value in radii.items())

    def summary(self) -> Summary:
        """What was found, and the commands that repeat it."""
        parts: list[Part] = [
            Facts(
                "This search",
                tuple(worst_page.facts(self.head, self.simulations, self.spent, self.budget, self.starts)),
            ),
            worst_page.largest(self.rules, self.criteria, self.cost, self.protocol_cost, {}),
            worst_page.requirements(self.rules, self.requirements, {}),
        ]
        if self.margins or self.radius:
            parts.append(worst_page.margin_table(self.rules, self.margins, self.radius))
        parts.append(
            Commands("to repeat these", tuple(worst_page.commands(self.criteria, self.requirements, self.margins)))
        )
        return Summary(f"Worst case of {self.controller.file}", self._kicker, (*parts, *self._remarks()))

    def report(self, file: str | Path, folder: str | Path | None = None) -> Path:
        """Write the report, one HTML page that needs no network; with the trajectories that were recorded in
        ``folder``, where the search was saved.

        Raises :class:`InputError` if they are damaged.
        """
        from ..views.page import page_html  # the templates' package takes time to load, which simulations need not

        write_text(Path(file), page_html(self.page(() if folder is None else load_recordings(Path(folder)))))
        return Path(file)

    def page(self, recordings: Sequence[Recording] = ()) -> Page:
        """The report, with the ``recordings`` of the worst cases."""
        worst = worst_page.cases(recordings)
        shown = {role.split(" ")[0]: n for n, (entry, _) in enumerate(worst) for role in entry.about.roles}
        left_out = [name for name in self.rules.criteria if name not in self.criteria]
        target = self.rules.cost.target
        left = (worst_page.headline(self.cost, self.protocol_cost, self.protocol, target, left_out),)
        right = (worst_page.requirements(self.rules, self.requirements, shown),)
        summary: tuple[Part, ...] = (
            *self._remarks(),
            Beside((left, right)),
            worst_page.largest(self.rules, self.criteria, self.cost, self.protocol_cost, shown),
            Facts(
                "This search",
                tuple(worst_page.facts(self.head, self.simulations, self.spent, self.budget, self.starts)),
            ),
        )
        listed = tuple(worst_page.commands(self.criteria, self.requirements, self.margins))
        panels = (Panel("summary", "Summary", summary), *self._panels(worst, listed))
        title = f"Worst case of {self.controller.file}: V = {number(self.cost)}"
        return Page(title, self._kicker, panels, self._conclusion(shown))

    def _conclusion(self, shown: Mapping[str, int]) -> Conclusion:
        """What was found of the requirements and of V, the worst of which is ``shown`` as a recording."""
        found = {name: entry.passed for name, entry in self.requirements.items()}
        verdict, names = overall(found), decisive(found)
        values = {name: entry.value for name, entry in self.criteria.items()}
        worst = names[0] if verdict is False else (costliest(self.rules, values) or ("",))[0]
        steps: list[Link] = []
        if command := self._repeating(worst):
            steps.append(Link(f"{'see' if worst in shown else 'simulate'} the worst case of {worst}", command,
                              shown.get(worst)))  # fmt: skip
        if self.margins or self.radius:
            steps.append(Link("see margins and radius", panel="margins"))
        if verdict is False:
            steps.append(Link("tune against the worst case", tune_command(self.head, *ROBUST)))
        else:
            steps.append(Link("bound the probability of a failure", study_command(self.head, "reliability")))
        return conclusions.conclusion(verdict, (self._found(found), self._cost_found(values)), steps)

    def _found(self, found: Mapping[str, bool | None]) -> str:
        """What was found of the requirements; how long it was searched stands with what was not found."""
        verdict, names = overall(found), decisive(found)
        if not names:
            return ""
        searched = f"in {self.simulations} simulations, {self.spent:.0f} of a budget of {self.budget} whole cases"
        if verdict:
            return f"No failure of {listed(names)} was found ({searched})"
        if verdict is None:
            return f"No failure was found ({searched}), and {verdict_words(found)}"
        fail = "fails" if len(names) == 1 else "fail"
        return (
            f"{listed(names)} {fail} for an arm within the tolerances: {worst_page.ending(self.requirements[names[0]])}"
        )

    def _cost_found(self, values: Mapping[str, float | None]) -> str:
        """V from what was found, a lower bound, and what costs most of it."""
        if self.cost is None:
            return "no V was found"
        marks = {"target": self.rules.cost.target, "on the list": self.protocol_cost}
        found = cost_words(f"V found, at least {number(self.cost)}", marks)
        return ", ".join(filter(None, (found, share_words(self.rules, values))))

    def _panels(
        self, worst: Sequence[tuple[Recording, Recording | None]], listed: tuple[tuple[str, str], ...]
    ) -> tuple[Panel, ...]:
        """The tabs behind the summary."""
        case: Part = WITHOUT
        motion: tuple[Part, ...] = (WITHOUT,)
        if worst:
            entries = affordable([entry for entry, _ in worst])
            nominal = [None if other is None else shortened(other, NOMINAL_ROWS) for _, other in worst]
            commands = [self._command(entry) for entry in entries]
            case = case_plots.cases(entries, self.rules, commands, nominal)
            motion = case_plots.motion(entries, self.rules, links(self.head.plant), commands)
        margins = worst_plots.margins(self.rules, self.margins, self.radius) or (NO_MARGINS,)
        return (
            Panel("search", "Search", (worst_plots.path_of_search(self.rules, self.criteria, self.path),)),
            Panel("effects", "Parameters", (self._effects(),)),
            Panel("case", "Time plots", (case,)),
            Panel("motion", "Motion", motion),
            Panel("configurations", "Workspace", (worst_plots.by_configuration(self.rules, self.configurations),)),
            Panel("margins", "Margins", margins),
            Panel("commands", "Commands", (Commands("commands that repeat what was found", listed),)),
        )

    def _command(self, entry: Recording) -> str:
        """The command that repeats the case that was recorded for a criterion or a requirement."""
        return self._repeating(entry.about.roles[0].split(" ")[0])

    def _repeating(self, name: str) -> str:
        """The command that repeats the worst case of a criterion or a requirement; empty if there is none."""
        if name in self.criteria:
            return self.criteria[name].worst_case.command
        return self.requirements[name].command if name in self.requirements else ""

    def _effects(self) -> Part:
        """By criterion, which parameters matter, and where they stand in the worst arm of each pose."""
        options: list[tuple[str, tuple[Part, ...]]] = []
        for name in worst_plots.searched(self.criteria, self.path):
            if any(effect.criterion == name for effect in self.effects):
                effects = worst_plots.effects(self.rules, name, self.effects)
                shown: Part = effects if effects.names else Note(effects.text, warning=False)
                ends = worst_plots.ends(self.rules, name, self.peaks, self.configurations)
                options.append((f"{name}, {self.rules.criteria[name].title.lower()}", (*ends, shown)))
        return Choice("effect", "Criterion", tuple(options)) if options else Note("No criterion was searched for.")

    @property
    def _kicker(self) -> str:
        return f"{self.benchmark}, protocol {self.protocol}, seed {self.seed}, {self.simulations} simulations"

    def _remarks(self) -> tuple[Note, ...]:
        """What a reader must know."""
        remarks = carry_over(self.head)
        if self.failures:
            remarks.append(f"{self.failures} simulations ended with crashed, timeout or error.")
        if self.cut_short:
            remarks.append(f"The budget of {self.budget} whole cases cut short: {', '.join(self.cut_short)}.")
        if not self.complete:
            remarks.append("Time ran out: the search is not complete.")
        return tuple(map(Note, remarks))

    @property
    def broken(self) -> tuple[str, ...]:
        """The requirements that a failure was found of."""
        return tuple(name for name, entry in self.requirements.items() if entry.passed is False)

    def __repr__(self) -> str:
        verdict = f"{', '.join(self.broken)} broken" if self.broken else "no requirement broken"
        if unknown := [name for name, entry in self.requirements.items() if entry.passed is None]:
            verdict += f", {', '.join(unknown)} not judged"
        return f"Robustness({self.controller.file}, {self.simulations} simulations: V = {number(self.cost)}, {verdict})"
