"""Tables for LaTeX with the package booktabs, none of them wider than the text of the class article."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence

from ..text import printable
from .table import Cell, Table, shown
from .units import Unit

TEXT_WIDTH = 345.0
"""Width of the text of LaTeX's class article at 10 pt [pt], into which a table must fit."""

CHARACTER, GAP = 4.3, 8.0
"""Widths at the size footnotesize [pt]: of a small character, generously (a digit has 4.25), and of the space between
two columns, 2 tabcolsep of 4 pt."""

WIDE = 2
"""Small characters that a capital, an m or a w counts for."""

LONGEST, SHORTEST = 40, 8
"""Characters of a column of words; longer ones are broken into lines. The first one where there is room, else as many
as let the keys and one more column stand beside each other, but no fewer than the second one."""

_SPECIAL = {char: f"\\{char}" for char in "&%$#_{}"} | {
    "\\": r"\textbackslash{}", "~": r"\textasciitilde{}", "^": r"\textasciicircum{}", "<": "$<$", ">": "$>$",
    "|": r"\textbar{}", "µ": r"$\mu$", "×": r"$\times$", "±": r"$\pm$", "°": r"$^\circ$",
}  # fmt: skip


def latex(tables: Sequence[Table]) -> str:
    """The tables; one wider than the text becomes several below each other, each with its keys."""
    parts = ["% \\usepackage{booktabs}"]
    for table in tables:
        parts += ["\\begin{table}", "  \\centering\\footnotesize\\setlength{\\tabcolsep}{4pt}"]
        parts.append(f"  \\caption{{{_text('. '.join(filter(None, (table.title, table.caption))))}}}")
        lengths = [_length(table, place) for place in range(len(table.columns))]
        most = _most(lengths, table.keys)
        widths = [_width(length, most) for length in lengths]
        for number, part in enumerate(table.fitting(widths, TEXT_WIDTH)):
            parts += [*(["", "  \\medskip"] if number else []), *_tabular(part, most)]
        parts.append("\\end{table}")
    return "\n".join(parts)


def _length(table: Table, place: int) -> int:
    """The characters of a column's longest cell."""
    column = table.columns[place]
    cells = (shown(row[place], column.unit) for row in (*table.rows, *table.footer))
    return max(map(_count, (column.name, f"[{column.unit.shown}]" if column.unit.shown else "", *cells)))


def _count(text: str) -> int:
    """The small characters that are as wide as a text."""
    return len(text) + sum(WIDE - 1 for char in text if char.isupper() or char in "mw@")


def _width(length: int, most: int) -> float:
    """The width of a column with the gap beside it [pt], if no line of it is longer than ``most`` characters."""
    return min(length, most) * CHARACTER + GAP


def _most(lengths: Sequence[int], keys: int) -> int:
    """After how many characters a line is broken."""
    most = LONGEST
    while most > SHORTEST and sum(_width(n, most) for n in (*lengths[:keys], max(lengths[keys:]))) > TEXT_WIDTH:
        most -= 1
    return most


def _tabular(table: Table, most: int) -> Iterator[str]:
    kinds = (_kind(table, place, most) for place in range(len(table.columns)))
    best = [table.best(place) for place in range(len(table.columns))]
    yield f"  \\begin{{tabular}}{{{''.join(kinds)}}}"
    yield "    \\toprule"
    yield "    " + _line(_text(column.name) for column in table.columns)
    if any(unit.shown for unit in table.units):
        yield "    " + _line(_text(f"[{unit.shown}]") if unit.shown else "" for unit in table.units)
    yield "    \\midrule"
    for number, row in enumerate(table.rows):
        cells = [_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)]
        yield "    " + _line(f"\\textbf{{{c}}}" if number in best[place] else c for place, c in enumerate(cells))
    if table.footer:
        yield "    \\midrule"
    for row in table.footer:
        yield "    " + _line(_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True))
    yield "    \\bottomrule"
    yield "  \\end{tabular}"


def _kind(table: Table, place: int, most: int) -> str:
    if _length(table, place) > most:
        return f"p{{{most * CHARACTER:.0f}pt}}"
    return "l" if table.is_text(place) else "r"


def _line(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _cell(cell: Cell, unit: Unit) -> str:
    words = "-" if cell is None else shown(cell, unit)
    return "--" if words == "-" else _text(words)


def _text(text: str) -> str:
    escaped = "".join(_SPECIAL.get(char, char) for char in " ".join(printable(text).split()))
    return f"{{}}{escaped}" if escaped.startswith(("[", "*")) else escaped  # else they belong to the row's end before
