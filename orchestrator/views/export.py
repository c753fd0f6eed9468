"""Tables as text for other programs: CSV with all digits in SI units, Markdown, and LaTeX with the package booktabs."""

from __future__ import annotations

import csv as writer
import io
import re
from collections.abc import Callable, Iterable, Iterator, Sequence
from typing import Any

from ..text import printable
from .table import Cell, Quantity, Table, Value, shown
from .units import NONE, Unit, heading, si_heading

FORMULA = re.compile(r'(^|[;\t])(?=[ "]*[=+\-@\t][\s\S])', re.MULTILINE)
"""Before what a spreadsheet takes for a formula, which has more than one character: at the beginning of a text, and, as
some split rows at semicolons or tabs and know nothing of the quotes then, behind these and in each line."""


def csv(tables: Sequence[Table]) -> str:
    """The tables with an empty line between them; a standard deviation has a column of its own."""
    return "\n".join(_csv_table(table) for table in tables).rstrip("\n")


def csv_text(header: Iterable[str], rows: Iterable[Iterable[Any]]) -> str:
    """Rows as CSV; each number with as few digits as determine it exactly."""
    stream = io.StringIO()
    made = writer.writer(stream, lineterminator="\n")
    # Headers are text of strangers, too: a sweep has a column for each parameter of an FMU.
    made.writerow(map(inert, header))
    made.writerows(map(inert, row) for row in rows)
    return stream.getvalue()


def inert(cell: Any) -> Any:
    """A cell that no spreadsheet takes for a formula, and no terminal for its own: an apostrophe precedes text that
    would run, and there are no control characters."""
    if not isinstance(cell, str):
        return cell
    text = printable(cell.replace("\r\n", "\n").replace("\r", "\n"))  # an unquoted lone carriage return ends a row
    return FORMULA.sub(r"\1'", text)  # a dash alone stands for nothing


def _csv_table(table: Table) -> str:
    rows = (*table.rows, *table.footer)
    spread = [
        any(isinstance(row[place], Value) and row[place].deviation is not None for row in rows)  # type: ignore[union-attr]
        for place in range(len(table.columns))
    ]
    header: list[str] = []
    for column, wide in zip(table.columns, spread, strict=True):
        name = si_heading(column.name, column.unit)
        header += [name, f"{name} standard deviation"] if wide else [name]
    return csv_text(header, (_csv_row(row, spread) for row in rows))


def _csv_row(row: Sequence[Cell], spread: Sequence[bool]) -> Iterator[str | float | None]:
    for cell, wide in zip(row, spread, strict=True):
        yield _plain(cell)
        if wide:
            yield cell.deviation if isinstance(cell, Value) else None


def _plain(cell: Cell) -> str | float | None:
    match cell:
        case Value(value=value, beyond=""):
            return value
        case Value(value=value, beyond=beyond):
            return f"{beyond} {value!r}"
        case Quantity():
            return si_heading(cell.name, cell.unit)
        case int() | float() | None:
            return cell
        case _:
            return shown(cell, NONE)


def markdown(tables: Sequence[Table]) -> str:
    """The tables, each below its title, the best values bold."""
    parts = []
    for table in tables:
        best = [table.best(place) for place in range(len(table.columns))]
        lines = [_markdown_line(escaped(heading(column.name, column.unit)) for column in table.columns)]
        lines.append(_markdown_line("---" if table.is_text(place) else "---:" for place in range(len(table.columns))))
        for number, row in enumerate(table.rows):
            cells = [_markdown_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)]
            lines.append(_markdown_line(f"**{c}**" if number in best[place] else c for place, c in enumerate(cells)))
        lines += [
            _markdown_line(_markdown_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True))
            for row in table.footer
        ]
        parts.append("\n".join([f"{escaped(table.title)}\n", *lines]))
    return "\n\n".join(parts)


def escaped(text: str) -> str:
    """Text in one line in which no character means something to Markdown, as GitHub has it."""
    return re.sub(r"([\\`*_\[\]<>|&~$])", r"\\\1", " ".join(printable(text).splitlines()))


def _markdown_cell(cell: Cell, unit: Unit) -> str:
    return "" if cell is None else escaped(shown(cell, unit))


def _markdown_line(cells: Iterable[str]) -> str:
    return f"| {' | '.join(cells)} |"


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
    "≤": r"$\leq$", "≥": r"$\geq$",
    "|": r"\textbar{}", "µ": r"$\mu$", "×": r"$\times$", "±": r"$\pm$", "°": r"$^\circ$",
}  # fmt: skip


def latex(tables: Sequence[Table]) -> str:
    """The tables, none of them wider than the text of the class article: a wider one becomes several below each other,
    each with its keys."""
    parts = ["% \\usepackage{booktabs}"]
    for table in tables:
        parts += ["\\begin{table}", "  \\centering\\footnotesize\\setlength{\\tabcolsep}{4pt}"]
        parts.append(f"  \\caption{{{latex_text('. '.join(filter(None, (table.title, table.caption))))}}}")
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
    yield "    " + _latex_line(latex_text(column.name) for column in table.columns)
    if any(unit.shown for unit in table.units):
        yield "    " + _latex_line(latex_text(f"[{unit.shown}]") if unit.shown else "" for unit in table.units)
    yield "    \\midrule"
    for number, row in enumerate(table.rows):
        cells = [_latex_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)]
        yield "    " + _latex_line(f"\\textbf{{{c}}}" if number in best[place] else c for place, c in enumerate(cells))
    if table.footer:
        yield "    \\midrule"
    for row in table.footer:
        yield "    " + _latex_line(_latex_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True))
    yield "    \\bottomrule"
    yield "  \\end{tabular}"


def _kind(table: Table, place: int, most: int) -> str:
    if _length(table, place) > most:
        return f"p{{{most * CHARACTER:.0f}pt}}"
    return "l" if table.is_text(place) else "r"


def _latex_line(cells: Iterable[str]) -> str:
    return " & ".join(cells) + r" \\"


def _latex_cell(cell: Cell, unit: Unit) -> str:
    words = "-" if cell is None else shown(cell, unit)
    return "--" if words == "-" else latex_text(words)


def latex_text(text: str) -> str:
    """Text in which no character means something to LaTeX."""
    escaped = "".join(_SPECIAL.get(char, char) for char in " ".join(printable(text).split()))
    return f"{{}}{escaped}" if escaped.startswith(("[", "*")) else escaped  # else they belong to the row's end before


FORMS: dict[str, tuple[str, Callable[[Sequence[Table]], str]]] = {
    "latex": ("LaTeX (booktabs)", latex),
    "markdown": ("Markdown", markdown),
    "csv": ("CSV, SI units", csv),
}
"""Forms of tables for a paper by the name of their option, each with the words of its help."""
