"""Summaries in a terminal. Colour and width are left to rich, which honours NO_COLOR and pipes."""

from __future__ import annotations

import codecs
import io
import sys

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table as Grid

from ..text import printable
from .table import Cell, Commands, Facts, Note, Summary, Table, Value, Verdict, shown
from .units import Unit

NARROW = 72
"""Characters per line, below which tables leave out minor columns."""

TINY = 50
"""Characters per line, below which any column may be folded."""

COLOURS = {True: "green", False: "red", None: "yellow"}

LOOK_ALIKES = {"µ": "u", "×": "x", "°": " deg", "…": "..."}
"""What stands for a character that the terminal's encoding does not have; for all others, a question mark."""


def terminal(stderr: bool = False) -> Console:
    """Where all commands print to. Names like ":x:" stay what they are; see :data:`LOOK_ALIKES`."""
    codecs.register_error("look-alike", _look_alike)
    stream = sys.stderr if stderr else sys.stdout
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="look-alike")
    return Console(stderr=stderr, emoji=False)


def show(summary: Summary, console: Console) -> None:
    """Print a summary. Commands are not wrapped: they are copied."""
    console.print(f"[bold]{safe(summary.title)}[/bold]  {safe(summary.kicker)}")
    for part in summary.parts:
        match part:
            case Table():
                console.print(grid(part, console.width))
            case Note(text, warning):
                console.print(safe(text), style="yellow" if warning else None, soft_wrap=not warning, highlight=False)
            case Facts(_, pairs, brief):
                for name, text in pairs:
                    if name in brief:
                        console.print(f"{safe(name.lower())} {safe(text)}", highlight=False)
            case Commands(title, pairs) if pairs:
                console.print(f"\n{title}:")
                for name, command in pairs:
                    lead = f"{safe(name)}\n  " if name else "  "
                    console.print(f"{lead}{safe(command)}", soft_wrap=True, highlight=False)


def grid(table: Table, width: int) -> Grid:
    """A table for ``width`` characters per line: without its minor columns if there is no room for them."""
    if width < NARROW:
        table = table.without([place for place, column in enumerate(table.columns) if column.minor])
    made = Grid(title=safe(table.title), title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    for place, column in enumerate(table.columns):
        words = table.is_text(place)
        heading = safe(column.name) + (f"\n\\[{column.unit.shown}]" if column.unit.shown else "")
        folded = words and (place > 0 or width < TINY)
        made.add_column(
            heading, justify="left" if words else "right", no_wrap=not folded, overflow="fold" if folded else "ellipsis"
        )
    best = [table.best(place) for place in range(len(table.columns))]
    for number, row in enumerate(table.rows):
        cells = [_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)]
        made.add_row(*(f"[bold]{c}[/bold]" if number in best[place] else c for place, c in enumerate(cells)))
    if table.footer:
        made.add_section()
    for row in table.footer:
        made.add_row(*(_cell(cell, unit) for cell, unit in zip(row, table.units, strict=True)))
    return made


def safe(text: str) -> str:
    """Text of a stranger for the console: without control characters, and without markup."""
    return escape(printable(text))


def _cell(cell: Cell, unit: Unit) -> str:
    words = safe(shown(cell, unit)) if cell is not None else ""
    if isinstance(cell, Verdict):
        return f"[{COLOURS[cell.passed]}]{words}[/{COLOURS[cell.passed]}]"
    if isinstance(cell, Value) and cell.good is not None:
        return f"[{COLOURS[cell.good]}]{words}[/{COLOURS[cell.good]}]"
    return words


def _look_alike(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(LOOK_ALIKES.get(c, "?") for c in error.object[error.start : error.end]), error.end
