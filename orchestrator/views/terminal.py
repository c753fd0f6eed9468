"""Summaries in a terminal. Colour and width are left to rich, which honours NO_COLOR and pipes."""

from __future__ import annotations

import codecs
import io
import sys
from collections.abc import Iterator

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Table as Grid
from rich.text import Text

from ..text import printable
from .table import Cell, Commands, Facts, Note, Summary, Table, Value, VerdictCell, shown
from .units import Unit

NARROW = 72
"""Characters per line, below which tables leave out minor columns."""

TINY = 50
"""Characters per line, below which any column may be folded."""

LEAST = 12
"""Characters that a column of words has at the least where there is room."""

COLOURS = {True: "green", False: "red", None: "yellow"}

LOOK_ALIKES = {"µ": "u", "×": "x", "°": " deg", "…": "..."}
"""What stands for a character that the terminal's encoding does not have; for all others, a question mark."""


def terminal(stderr: bool = False) -> Console:
    """Where all commands print to. Names like ":x:" stay what they are; see :data:`LOOK_ALIKES`."""
    codecs.register_error("look-alike", _look_alike)
    stream = sys.stderr if stderr else sys.stdout
    # A notebook's stream is none, and takes every character.
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="look-alike")
    return Console(stderr=stderr, emoji=False)


def show(summary: Summary, console: Console) -> None:
    """Print a summary. Commands are not wrapped: they are copied."""
    console.print(Text.assemble((printable(summary.title), "bold"), "  ", printable(summary.kicker)))
    for part in summary.parts:
        match part:
            case Table():
                console.print(*grids(part, console.width))
            case Note(text, warning):
                console.print(_text(text, "yellow" if warning else ""), soft_wrap=not warning)
            case Facts(_, pairs, brief):
                for name, text in pairs:
                    if name in brief:
                        console.print(_text(f"{name.lower()} {text}"))
            case Commands(title, pairs) if pairs:
                console.print(f"\n{title}:", highlight=False)
                for name, command in pairs:
                    console.print(_text(f"{name}\n  {command}" if name else f"  {command}"), soft_wrap=True)


def grids(table: Table, width: int) -> Iterator[Grid]:
    """A table for ``width`` characters per line: in several parts if it is wider than that."""
    if width < NARROW:
        table = table.without([place for place, column in enumerate(table.columns) if column.minor])
    best = [table.best(place) for place in range(len(table.columns))]
    marked = {table.columns[place]: rows for place, rows in enumerate(best)}
    widths = [_width(table, place) + 2 for place in range(len(table.columns))]
    for number, part in enumerate(table.fitting(widths, width)):
        title = None if number else _text(table.title)
        made = Grid(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
        for place, column in enumerate(part.columns):
            words = part.is_text(place)
            heading = _text(column.name + (f"\n[{column.unit.shown}]" if column.unit.shown else ""))
            least = None if width < TINY else min(_width(part, place), LEAST)
            made.add_column(
                heading, justify="left" if words else "right", no_wrap=not words, overflow="fold", min_width=least
            )
        for row_number, row in enumerate(part.rows):
            cells = zip(part.columns, row, strict=True)
            made.add_row(*(_cell(cell, column.unit, row_number in marked[column]) for column, cell in cells))
        if part.footer:
            made.add_section()
        for row in part.footer:
            made.add_row(*(_cell(cell, unit) for cell, unit in zip(row, part.units, strict=True)))
        yield made


def _width(table: Table, place: int) -> int:
    """The characters that a column needs; words can be folded."""
    column = table.columns[place]
    cells = [shown(row[place], column.unit) for row in (*table.rows, *table.footer) if row[place] is not None]
    longest = max(map(len, (*column.name.split("\n"), *cells)), default=0)
    return min(longest, LEAST) if table.is_text(place) else longest


def _text(text: str, style: str = "") -> Text:
    """Text of an FMU or a file for the console: without control characters, and none of it taken for markup."""
    return Text(printable(text), style)


def _cell(cell: Cell, unit: Unit, best: bool = False) -> Text:
    judged = cell.passed if isinstance(cell, VerdictCell) else cell.good if isinstance(cell, Value) else None
    colour = COLOURS[judged] if isinstance(cell, VerdictCell) or judged is not None else ""
    return _text("" if cell is None else shown(cell, unit), f"{colour} bold".strip() if best else colour)


def _look_alike(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(LOOK_ALIKES.get(c, "?") for c in error.object[error.start : error.end]), error.end
