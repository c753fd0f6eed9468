"""Tables as CSV: numbers with all digits, in SI units."""

from __future__ import annotations

import csv as writer
import io
from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from ..text import printable
from .table import Cell, Quantity, Table, Value, shown
from .units import NONE, si_heading

FORMULA = ("=", "+", "-", "@", "\t")
"""First characters by which a spreadsheet takes a text for a formula."""


def csv(tables: Sequence[Table]) -> str:
    """The tables with an empty line between them; a standard deviation has a column of its own."""
    return "\n".join(_of(table) for table in tables).rstrip("\n")


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
    return f"'{text}" if text.startswith(FORMULA) and len(text) > 1 else text  # a dash alone stands for nothing


def _of(table: Table) -> str:
    rows = (*table.rows, *table.footer)
    spread = [
        any(isinstance(row[place], Value) and row[place].deviation is not None for row in rows)  # type: ignore[union-attr]
        for place in range(len(table.columns))
    ]
    header: list[str] = []
    for column, wide in zip(table.columns, spread, strict=True):
        name = si_heading(column.name, column.unit)
        header += [name, f"{name} standard deviation"] if wide else [name]
    return csv_text(header, (_row(row, spread) for row in rows))


def _row(row: Sequence[Cell], spread: Sequence[bool]) -> Iterator[str | float | None]:
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
