"""Documents of any kind side by side: which may be compared, in which order, and why the others may not."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence, Set
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, overload

from ..codec import plain
from ..entry import results
from ..text import shortened
from ..views.table import (
    Cell,
    Column,
    Conclusion,
    Link,
    Note,
    Page,
    Panel,
    Part,
    Summary,
    Table,
    Value,
    VerdictCell,
    shown,
)
from ..views.table import plain as number_in
from ..views.units import number
from . import compare_page, conclusions
from .commands import study_command
from .comparability import Conditions, Entry, conditions, same_fmu
from .document import Comparable, Displayable, Row
from .evaluation import Evaluation
from .head import ControllerRecord
from .spread import Spread
from .wording import SEED_MATTERS


@dataclass(frozen=True)
class Group:
    """Documents of one kind under equal conditions, best first: those that meet all requirements, then by V.

    ``unranked`` pairs those that have no rank with the reason. ``difference`` says what sets the group apart from the
    first one of its kind; empty for the first.
    """

    kind: str
    conditions: Conditions
    ranked: tuple[Entry, ...]
    unranked: tuple[tuple[Entry, str], ...]
    difference: str

    @property
    def title(self) -> str:
        """The kind and the conditions in words."""
        return f"{self.kind}: {self.conditions.title}"

    @property
    def entries(self) -> tuple[Entry, ...]:
        """All, those without a rank last."""
        return *self.ranked, *(entry for entry, _ in self.unranked)

    @property
    def notes(self) -> tuple[str, ...]:
        """What a reader must know before trusting the ranks."""
        notes = [f"Not ranked with the above: {self.difference}."] if self.difference else []
        notes += [f"Not ranked: {entry.name}: {reason}." for entry, reason in self.unranked]
        name = self.conditions.protocol
        if self.conditions.seed is not None and name in ("quick", "tuning"):
            notes.append(f"Protocol {name}: {SEED_MATTERS}. Compare with several seeds.")
        return tuple(notes)

    def table(self) -> Table:
        """A row for each document, and what to compare with."""
        columns = list(dict.fromkeys(column for entry in self.entries for column, _ in entry.row))
        ranks = [*(str(rank) for rank, _ in enumerate(self.ranked, start=1)), *("-" for _ in self.unranked)]
        rows = [
            (rank, entry.name, *(_cell(entry.row, column) for column in columns))
            for rank, entry in zip(ranks, self.entries, strict=True)
        ]
        rules = self.conditions.rules
        footer: list[tuple[Cell, ...]] = []
        for words, which in (("target", "target"), ("paper's PID", "paper")):
            values = {"V": getattr(rules.cost, which)}
            values |= {name: getattr(spec, which) for name, spec in rules.criteria.items()}
            footer.append(("", words, *(values.get(column.name) for column in columns)))
        shown = (Column("rank"), Column("controller"), *columns)
        good = [not entry.document.rank.reason and entry.document.rank.holds for entry in self.entries]
        outside = frozenset(place for place, one in enumerate(good) if not one)
        table = Table(self.title, shown, tuple(rows), tuple(footer), keys=2, outside=outside)
        marked = any(table.best(place) for place in range(len(shown)))
        return replace(table, caption="Bold: the best values of those that meet all requirements.") if marked else table


TABS = {
    "bars": "see the criteria",
    "difference": "see where in the workspace they differ",
    "overlay": "see the worst cases over each other",
    "seeds": "see V over the seeds",
}
"""What to look at next, by the tab that has it."""


def _ahead(first: Entry, second: Entry) -> str:
    """By how much, and why the ``second`` is behind."""
    one, other = first.document, second.document
    if one.rank.holds and not other.rank.holds:
        return f"the second, {second.name} with V {number(other.V)}, does not meet all requirements"
    words = f"the second, {second.name}, has {number((other.V or 0.0) - (one.V or 0.0))} more"
    if isinstance(one, Evaluation) and isinstance(other, Evaluation):
        shares = {name: (score.share or 0.0, other.criteria[name].share or 0.0) for name, score in one.criteria.items()}
        name = max(shares, key=lambda criterion: shares[criterion][1] - shares[criterion][0])
        words += f", most of it by {name} ({number(shares[name][1])} against {number(shares[name][0])})"
    return words


@dataclass(frozen=True)
class Comparison(Displayable, Sequence[Group]):
    """What :func:`compare` finds: a sequence of groups; shows itself in a notebook."""

    groups: tuple[Group, ...]

    def __len__(self) -> int:
        return len(self.groups)

    @overload
    def __getitem__(self, place: int) -> Group: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Group, ...]: ...

    def __getitem__(self, place: int | slice) -> Group | tuple[Group, ...]:
        return self.groups[place]

    @property
    def first(self) -> dict[str, tuple[Entry, ...]]:
        """The documents of the first group of each kind: what charts and figures show."""
        return {group.kind: group.entries for group in reversed(self.groups)}

    def summary(self) -> Summary:
        """A table for each group."""
        parts: list[Part] = []
        for group in self.groups:
            parts += [group.table(), *map(Note, group.notes)]
        return Summary("Comparison of controllers", _kicker(self.groups), tuple(parts))

    def page(self) -> Page:
        """The tables, and charts of the first group of each kind."""
        summary = self.summary()
        listed = (entry.document for group in self.groups for entry in group.entries)
        everything = [(_controller(document.head.controller), document) for document in listed]
        panels = (Panel("leaderboard", "Leaderboard", summary.parts), *compare_page.panels(self.first, everything))
        return Page(summary.title, summary.kicker, panels, self._conclusion({panel.id for panel in panels}))

    def _conclusion(self, tabs: Set[str]) -> Conclusion | None:
        """Who is first in the first group, by how much, and by which criterion; and the tabs that show it."""
        if not self.groups:
            return None
        group = self.groups[0]
        steps = [Link(words, panel=tab) for tab, words in TABS.items() if tab in tabs]
        if not group.ranked:
            reason = "; ".join(f"{entry.name}: {reason}" for entry, reason in group.unranked[:1])
            return conclusions.conclusion(None, (f"None of {len(group.entries)} has a rank ({reason})",), steps)
        first, *others = group.ranked
        rank = first.document.rank
        place = f"{first.name} is first of {len(group.ranked)} ranked, with V {number(rank.V)}"
        met = "meets all requirements" if rank.holds else "no one meets all requirements"
        words = [f"{place}, and {met}", *([_ahead(first, others[0])] if others else [])]
        worst = study_command(first.document.head, "robustness")
        if group.kind in (Evaluation.KIND, Spread.KIND):
            steps.append(Link("search for the worst case of the first", worst))
        return conclusions.conclusion(rank.holds, words, steps)

    def document(self) -> dict[str, Any]:
        """The comparison as plain values in SI units."""
        return {"groups": [_plain(group) for group in self.groups]}

    def __repr__(self) -> str:
        lines = (f"{group.title}: {', '.join(entry.name for entry in group.entries)}" for group in self.groups)
        return f"Comparison({'; '.join(lines)})"


def compare(documents: Iterable[Comparable]) -> Comparison:
    """Evaluations, and other results of the benchmark, in groups that may be ranked together.

    A group holds those of one kind under equal conditions: benchmark version, protocol, rules, seed, sample time and
    plant; of each kind the largest group comes first. Its ``ranked`` entries are in order, those that meet all
    requirements first, then by V. Raises :class:`InputError` for what is no result.
    """
    entered = results("documents", documents)
    return grouped([(document, getattr(document, "folder", None)) for document in entered])


def grouped(documents: Sequence[tuple[Comparable, Path | None]]) -> Comparison:
    """The documents in groups, those of one kind together, and of each kind the largest group first."""
    listed = names([(document.head.controller, folder) for document, folder in documents])
    controllers = places([document.head.controller for document, _ in documents])
    firsts = [controllers.index(place) for place in range(len(set(controllers)))]
    titles = names([(documents[first][0].head.controller, documents[first][1]) for first in firsts])
    everything = [(name, document) for name, (document, _) in zip(listed, documents, strict=True)]
    groups: dict[str, list[tuple[Conditions, list[Entry]]]] = {Evaluation.KIND: [], Spread.KIND: []}  # these first
    for name, place, (document, folder) in zip(listed, controllers, documents, strict=True):
        of_kind, setup = groups.setdefault(document.KIND, []), conditions(document.head)
        there = next((entries for common, entries in of_kind if common == setup), None)
        if there is None:
            of_kind.append((setup, there := []))
        first = there[0].document if there else None
        there.append(Entry(name, document, folder, document.row(first, everything), place, titles[place]))
    ordered = []
    for kind, of_kind in groups.items():
        of_kind.sort(key=lambda group: len(group[1]), reverse=True)
        for common, entries in of_kind:
            ranks = [(entry, entry.document.rank) for entry in entries]
            ranked = sorted((pair for pair in ranks if not pair[1].reason), key=lambda pair: pair[1].key)
            unranked = tuple((entry, rank.reason) for entry, rank in ranks if rank.reason)
            ordered.append(Group(kind, common, tuple(e for e, _ in ranked), unranked, common.difference(of_kind[0][0])))
    return Comparison(tuple(ordered))


def places(controllers: Sequence[ControllerRecord]) -> list[int]:
    """The place of each controller among the different ones, in the order in which they are given."""
    different: list[ControllerRecord] = []
    for one in controllers:
        if not any(same_fmu(one, other) for other in different):
            different.append(one)
    return [next(place for place, other in enumerate(different) if same_fmu(one, other)) for one in controllers]


def names(listed: Sequence[tuple[ControllerRecord, Path | None]]) -> list[str]:
    """A name for each: the controller's with its parameters, and the folder or the place if that is not enough."""
    plain_names = [_controller(controller) for controller, _ in listed]
    folders = (folder for _, folder in listed)
    places = [f"run {i}" if folder is None else os.path.normpath(folder) for i, folder in enumerate(folders, start=1)]
    counts = Counter(plain_names)
    return [f"{name} ({place})" if counts[name] > 1 else name for name, place in zip(plain_names, places, strict=True)]


def _controller(controller: ControllerRecord) -> str:
    parameters = ", ".join(f"{name}={shortened(value)}" for name, value in controller.parameters.items())
    return controller.file.removesuffix(".fmu") + (f" [{parameters}]" if parameters else "")


def _kicker(groups: Sequence[Group]) -> str:
    return groups[0].conditions.title if groups else ""


def _cell(row: Row, column: Column) -> Cell:
    return next((cell for header, cell in row if header == column), None)


def _plain(group: Group) -> dict[str, Any]:
    return {
        "kind": group.kind,
        "conditions": plain(group.conditions),
        "difference": group.difference,
        "notes": list(group.notes),
        "ranked": [{"rank": rank, **_entry(entry)} for rank, entry in enumerate(group.ranked, start=1)],
        "unranked": [{"reason": reason, **_entry(entry)} for entry, reason in group.unranked],
    }


def _entry(entry: Entry) -> dict[str, Any]:
    return {
        "name": entry.name,
        "folder": None if entry.folder is None else str(entry.folder),
        "sha256": entry.document.head.controller.sha256,
        "complete": getattr(entry.document, "complete", entry.document.completeness == "complete"),
        "figures": {column.name: value for column, cell in entry.row for value in _values(column, cell)},
    }


def _values(column: Column, cell: Cell) -> Iterator[Any]:
    match cell:
        case VerdictCell(passed, _):
            yield passed
        case Value(deviation=float() as deviation):
            yield {"mean": cell.value, "deviation": deviation}
        case str():
            yield cell
        case _ if cell is None or number_in(cell) is not None:
            yield None if cell is None else number_in(cell)
        case _:
            yield shown(cell, column.unit)
