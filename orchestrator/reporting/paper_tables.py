"""The comparison as tables for a paper: LaTeX, Markdown and CSV, in the units of the paper's tables."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from ..benchmark.spread import Statistic
from ..search.findings import CriterionFound, Margin
from ..text import printable
from .beside import SpreadGroup, WorstEntry
from .comparison import Group
from .files import csv_text
from .tables import inert
from .wording import SHOWN, VERDICTS, number


class Mean(NamedTuple):
    """A mean and its standard deviation."""

    value: float | None
    deviation: float | None


Cell = str | float | Mean | None
"""Words, a figure, or none where there is no value."""


@dataclass(frozen=True)
class Table:
    """Rows under headings, such as ``B5 [mm]``; the first column names the controller."""

    title: str
    headings: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]


def tables(groups: Sequence[Group], spreads: Sequence[SpreadGroup], worst: Sequence[WorstEntry]) -> list[Table]:
    """One table for each group of runs and of spreads, and one of all searches for the worst case."""
    found = [_leaderboard(group) for group in groups] + [_spread(group) for group in spreads]
    return [*found, _worst(worst)] if worst else found


def _leaderboard(group: Group) -> Table:
    rules = group.conditions.rules
    verdicts = tuple(group.entries[0].run.results.stability)
    units = {name: SHOWN[spec.unit] for name, spec in rules.criteria.items()}
    rows: list[tuple[Cell, ...]] = []
    for entry in group.entries:
        results = entry.run.results
        values = (_times(results.criteria[name].value, factor) for name, (factor, _) in units.items())
        held = (VERDICTS[results.stability[name].passed] for name in verdicts)
        rows.append((entry.name, entry.cost, *values, *held))
    for words, which in (("target", "target"), ("paper's PID", "paper")):
        values = (getattr(spec, which) * units[name][0] for name, spec in rules.criteria.items())
        rows.append((words, getattr(rules.cost, which), *values, *(None for _ in verdicts)))
    title = f"{group.title}; not ranked with the first table: {group.difference}" if group.difference else group.title
    return Table(title, ("controller", "V", *_headings(units), *verdicts), tuple(rows))


def _spread(group: SpreadGroup) -> Table:
    units = {name: SHOWN[spec.unit] for name, spec in group.conditions.rules.criteria.items()}
    verdicts = tuple(group.entries[0].spread.requirements)
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (
            entry.name,
            str(len(entry.spread.seeds)),
            _mean(entry.spread.cost, 1.0),
            *(_mean(entry.spread.criteria[name], factor) for name, (factor, _) in units.items()),
            *(f"{held.seeds}/{held.of}" for held in map(entry.spread.requirements.__getitem__, verdicts)),
        )
        for entry in group.entries
    )
    return Table(group.conditions.title, ("controller", "seeds", "V", *_headings(units), *verdicts), rows)


def _worst(entries: Sequence[WorstEntry]) -> Table:
    shared: dict[str, tuple[float, str]] = {
        name: SHOWN[entry.found.criteria[name].unit]
        for name in ("B5", "B6")
        for entry in entries
        if name in entry.found.criteria
    }
    margins = {name: None for entry in entries for name in entry.found.margins}
    rows = tuple(
        (
            entry.name,
            entry.V,
            entry.found.cost,
            *(_largest(entry.found.criteria.get(name), factor) for name, (factor, _) in shared.items()),
            entry.verdicts,
            entry.broken,
            *(_margin(name, entry.found.margins.get(name)) for name in margins),
        )
        for entry in entries
    )
    largest = (f"largest {each}" for each in _headings(shared))
    headings = ("controller", "V", "V found", *largest, "fails", "fails at worst")
    shown = (name.replace("_", " ") + (" [ms]" if name.startswith("delay") else "") for name in margins)
    return Table("Worst case found, beside the scorecard", (*headings, *shown), rows)


def _headings(units: Mapping[str, tuple[float, str]]) -> Iterator[str]:
    return (f"{name} [{unit}]" for name, (_, unit) in units.items())


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _mean(found: Statistic, factor: float) -> Mean:
    return Mean(_times(found.mean, factor), _times(found.deviation, factor))


def _largest(found: CriterionFound | None, factor: float) -> Cell:
    if found is None or (found.worst_case.value is None and not found.worst_case.command):
        return None
    return "unstable" if found.worst_case.value is None else found.worst_case.value * factor


def _margin(name: str, margin: Margin | None) -> Cell:
    """A margin, [ms] if it is a delay; what none was found up to."""
    if margin is None:
        return None
    factor = 1e3 if name.startswith("delay") else 1.0
    beyond = f"{'<' if name.endswith('down') else '>'} {number(margin.limit, factor)}"
    return beyond if margin.value is None else margin.value * factor


def latex(found: Sequence[Table]) -> str:
    """Tables for LaTeX with the package booktabs."""
    parts = ["% \\usepackage{booktabs}"]
    for table in found:
        numeric = "".join("l" if _words(table, column) else "r" for column in range(len(table.headings)))
        lines = [" & ".join(_latex_cell(cell) for cell in row) + r" \\" for row in (table.headings, *table.rows)]
        parts += [
            "\\begin{table}",
            "  \\centering",
            f"  \\caption{{{_latex_text(table.title)}}}",
            f"  \\begin{{tabular}}{{{numeric}}}",
            "    \\toprule",
            f"    {lines[0]}",
            "    \\midrule",
            *(f"    {line}" for line in lines[1:]),
            "    \\bottomrule",
            "  \\end{tabular}",
            "\\end{table}",
        ]
    return "\n".join(parts)


def markdown(found: Sequence[Table]) -> str:
    """Tables for Markdown."""
    parts = []
    for table in found:
        rule = ("---" if _words(table, column) else "---:" for column in range(len(table.headings)))
        rows = [[_markdown_text(_text(cell, " ± ")) for cell in row] for row in (table.headings, *table.rows)]
        lines = [f"| {' | '.join(row)} |" for row in rows]
        parts.append("\n".join([f"{_markdown_text(table.title)}\n", lines[0], f"| {' | '.join(rule)} |", *lines[1:]]))
    return "\n\n".join(parts)


def csv(found: Sequence[Table]) -> str:
    """Tables as CSV with an empty line between them; figures with all digits, standard deviations in columns of their
    own."""
    return "\n".join(csv_text(*_flat(table)) for table in found).rstrip("\n")


FORMATS: Mapping[str, Callable[[Sequence[Table]], str]] = {"latex": latex, "markdown": markdown, "csv": csv}
"""How tables are written, by name."""


def _flat(table: Table) -> tuple[list[str], list[list[str | float | None]]]:
    """Headings and rows, each mean as two columns."""
    double = [any(isinstance(row[column], Mean) for row in table.rows) for column in range(len(table.headings))]
    headings: list[str] = []
    for heading, two in zip(table.headings, double, strict=True):
        headings += [heading, f"{heading} standard deviation"] if two else [heading]
    rows = ((part for cell in row for part in (cell if isinstance(cell, Mean) else (cell,))) for row in table.rows)
    return headings, [[inert(cell) for cell in row] for row in rows]


def _words(table: Table, column: int) -> bool:
    """Whether a column holds words: they begin at the left."""
    return any(isinstance(row[column], str) and not _BEYOND.match(str(row[column])) for row in table.rows)


_BEYOND = re.compile(r"[<>] ?[0-9]|[0-9]+(/[0-9]+)?$")
"""Words that stand among figures."""


def _text(cell: Cell, plus_minus: str) -> str:
    if isinstance(cell, Mean):
        deviation = "" if cell.deviation is None else f"{plus_minus}{number(cell.deviation)}"
        return number(cell.value) + deviation
    return printable(cell) if isinstance(cell, str) else number(cell)


_LATEX = {char: f"\\{char}" for char in "&%$#_{}"} | {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$"
}  # fmt: skip


def _latex_text(text: str) -> str:
    escaped = "".join(_LATEX.get(char, char) for char in printable(text))
    return f"{{}}{escaped}" if escaped.startswith(("[", "*")) else escaped  # else they belong to the row's end before


def _latex_cell(cell: Cell) -> str:
    if isinstance(cell, str):
        return _latex_text(cell)
    shown = _text(cell, r" \pm ")
    return f"${shown}$" if "pm" in shown else "--" if shown == "-" else shown


def _markdown_text(text: str) -> str:
    return re.sub(r"([\\`*_\[\]<>|])", r"\\\1", text)
