"""The comparison as tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .comparison import Entry, Group
from .terminal import NARROW, table
from .wording import SHOWN, number, requirement_rows

SIGNS = {True: "[green]holds[/green]", False: "[red]fails[/red]", None: "-"}


def show_comparison(groups: Sequence[Group], console: Console) -> None:
    """Print a leaderboard a group, the reasons for more than one group, and for runs without a rank."""
    for group in groups:
        if group.difference:
            console.print(f"[yellow]Not ranked with the above:[/yellow] {escape(group.difference)}")
        console.print(_leaderboard(group, console.width < NARROW))
        console.print(_verdicts(group))
        for entry, reason in group.unranked:
            console.print(f"[yellow]Not ranked:[/yellow] {escape(entry.name)}: {escape(reason)}")


def _entries(group: Group) -> list[tuple[str, Entry]]:
    ranked = [(str(rank), entry) for rank, entry in enumerate(group.ranked, start=1)]
    return [*ranked, *(("-", entry) for entry, _ in group.unranked)]


def _leaderboard(group: Group, narrow: bool) -> Table:
    entries = _entries(group)
    criteria = {} if narrow else entries[0][1].run.document["criteria"]
    grid = table(escape(group.title))
    grid.add_column("", no_wrap=True)
    grid.add_column("controller", overflow="fold", min_width=10)
    grid.add_column("V", justify="right", no_wrap=True)
    for name, entry in criteria.items():
        grid.add_column(f"{name}\n\\[{SHOWN[entry['unit']][1]}]", justify="right", no_wrap=True)
    for rank, entry in entries:
        document = entry.run.document
        values = [
            number(None if row["value"] is None else row["value"] * SHOWN[row["unit"]][0])
            for row in (document["criteria"][name] for name in criteria)
        ]
        grid.add_row(rank, escape(entry.name), f"[bold]{number(document['cost'])}[/bold]", *values)
    grid.add_section()
    targets = [number(row["target"] * SHOWN[row["unit"]][0]) for row in criteria.values()]
    grid.add_row("", "target", number(entries[0][1].run.document["rules"]["cost"]["target"]), *targets)
    return grid


def _verdicts(group: Group) -> Table:
    entries = _entries(group)
    grid = table("Requirements")
    grid.add_column("", no_wrap=True)
    grid.add_column("controller", overflow="fold", min_width=10)
    for row in requirement_rows(entries[0][1].run.document):
        grid.add_column(f"{row['name']}\n{'axis ' + row['axis'] if row['axis'] else 'all'}", no_wrap=True)
    for rank, entry in entries:
        words = [SIGNS[row["passed"]] for row in requirement_rows(entry.run.document)]
        grid.add_row(rank, escape(entry.name), *words)
    return grid
