"""Tables in Markdown."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence

from ..text import printable
from .table import Cell, Table, shown
from .units import Unit, heading


def markdown(tables: Sequence[Table]) -> str:
    """The tables, each below its title, the best values bold."""
    parts = []
    for table in tables:
        best = [table.best(place) for place in range(len(table.columns))]
        lines = [_line(escaped(heading(column.name, column.unit)) for column in table.columns)]
        lines.append(_line("---" if table.is_text(place) else "---:" for place in range(len(table.columns))))
        for number, row in enumerate(table.rows):
            cells = [_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)]
            lines.append(_line(f"**{c}**" if number in best[place] else c for place, c in enumerate(cells)))
        lines += [_line(_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)) for row in table.footer]
        parts.append("\n".join([f"{escaped(table.title)}\n", *lines]))
    return "\n\n".join(parts)


def escaped(text: str) -> str:
    """Text in one line in which no character means something to Markdown, as GitHub has it."""
    return re.sub(r"([\\`*_\[\]<>|&~$])", r"\\\1", " ".join(printable(text).splitlines()))


def _cell(cell: Cell, unit: Unit) -> str:
    return "" if cell is None else escaped(shown(cell, unit))


def _line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"
