"""The comparison as tables for a terminal."""

from __future__ import annotations

from collections.abc import Sequence

from rich.console import Console
from rich.table import Table

from ..reporting.beside import SpreadGroup, WorstEntry
from ..reporting.comparison import Entry, Group
from ..reporting.spread import mean_words, spread_remarks
from ..reporting.wording import SHOWN, VERDICTS, figure, number, requirement_rows
from .tables import COLOURS, NARROW, safe, table

SIGNS = {passed: f"[{COLOURS[word]}]{word}[/{COLOURS[word]}]" for passed, word in VERDICTS.items()}


def show_comparison(groups: Sequence[Group], console: Console) -> None:
    """Print a leaderboard per group, the reasons for more than one group, and for runs without a rank."""
    for group in groups:
        if group.difference:
            console.print(f"[yellow]Not ranked with the above:[/yellow] {safe(group.difference)}")
        console.print(_leaderboard(group, console.width < NARROW))
        console.print(_verdicts(group, console.width < NARROW))
        for note in group.notes:
            console.print(f"[yellow]{safe(note)}[/yellow]")
        for entry, reason in group.unranked:
            console.print(f"[yellow]Not ranked:[/yellow] {safe(entry.name)}: {safe(reason)}")


def _rows(group: Group) -> list[tuple[str, Entry]]:
    ranked = [(str(rank), entry) for rank, entry in enumerate(group.ranked, start=1)]
    return [*ranked, *(("-", entry) for entry, _ in group.unranked)]


def _leaderboard(group: Group, narrow: bool) -> Table:
    rules = group.conditions.rules
    criteria = {} if narrow else rules.criteria
    grid = table(safe(group.title))
    grid.add_column("", no_wrap=True)
    grid.add_column("controller", overflow="fold", min_width=10)
    grid.add_column("V", justify="right", no_wrap=True)
    for name, spec in criteria.items():
        grid.add_column(f"{name}\n\\[{SHOWN[spec.unit][1]}]", justify="right", no_wrap=True)
    for rank, entry in _rows(group):
        results = entry.run.results
        values = [figure(spec, results.criteria[name].value) for name, spec in criteria.items()]
        grid.add_row(rank, safe(entry.name), f"[bold]{number(results.cost)}[/bold]", *values)
    grid.add_section()
    grid.add_row("", "target", number(rules.cost.target), *(figure(spec, spec.target) for spec in criteria.values()))
    grid.add_row("", "paper's PID", number(rules.cost.paper), *(figure(spec, spec.paper) for spec in criteria.values()))
    return grid


def _verdicts(group: Group, narrow: bool) -> Table:
    """The verdicts; if there is no room, only the rank names the controller."""
    grid = table("Requirements")
    grid.add_column("", no_wrap=True)
    if not narrow:
        grid.add_column("controller", overflow="fold", min_width=10)
    for row in requirement_rows(group.entries[0].run.results):
        axis = row.axis if narrow else f"axis {row.axis}"
        grid.add_column(f"{row.name}\n{axis if row.axis else 'all'}", overflow="fold")
    for rank, entry in _rows(group):
        words = [SIGNS[row.judged.passed] for row in requirement_rows(entry.run.results)]
        grid.add_row(rank, *(() if narrow else (safe(entry.name),)), *words)
    return grid


def show_spreads(groups: Sequence[SpreadGroup], console: Console) -> None:
    """Print what several seeds came to, per group, and the differences from its first controller."""
    narrow = console.width < NARROW
    for group in groups:
        if group.difference:
            console.print(f"[yellow]Not comparable to the above:[/yellow] {safe(group.difference)}")
        grid, rules = _named(f"Mean ± standard deviation: {safe(group.conditions.title)}"), group.conditions.rules
        for heading in ("seeds", "V", *group.entries[0].spread.requirements):
            grid.add_column(heading, justify="right", overflow="fold")
        for entry in group.entries:
            spread = entry.spread
            held = [f"{each.seeds}/{each.of}" for each in spread.requirements.values()]
            grid.add_row(safe(entry.name), str(len(spread.seeds)), mean_words(spread.cost), *held)
        console.print(grid)
        if not narrow:
            grid = _named("Criteria")
            for name, spec in rules.criteria.items():
                grid.add_column(f"{name}\n\\[{SHOWN[spec.unit][1]}]", justify="right", no_wrap=True)
            for entry in group.entries:
                words = (
                    mean_words(entry.spread.criteria[name], SHOWN[spec.unit][0])
                    for name, spec in rules.criteria.items()
                )
                grid.add_row(safe(entry.name), *(word.replace(" ±", "\n±") for word in words))
            console.print(grid)
        for entry in group.entries[1:]:
            console.print(f"V of {safe(entry.name)} minus that of {safe(group.entries[0].name)}: {entry.better}")
        for entry in group.entries:
            for remark in spread_remarks(entry.spread):
                console.print(f"[yellow]{safe(entry.name)}: {safe(remark)}[/yellow]")


def show_worst(entries: Sequence[WorstEntry], console: Console) -> None:
    """Print what searches for the worst case found, beside the scorecards."""
    if not entries:
        return
    grid = _named("Worst case found, beside the scorecard")
    grid.add_column("scorecard", overflow="fold")
    for heading in ("V", "fails", "V\nfound", "B5\nlargest", "B6\nlargest", "fails\nat worst"):
        grid.add_column(heading, justify="right", overflow="fold")
    for entry in entries:
        largest = (entry.largest.get(name, "-") for name in ("B5", "B6"))
        card = (safe(entry.conditions), number(entry.V), safe(entry.verdicts))
        grid.add_row(safe(entry.name), *card, number(entry.found.cost), *largest, safe(entry.broken))
    console.print(grid)
    for entry in {entry.name: entry for entry in entries}.values():
        words = "; ".join(f"{name} {value}" for name, value in entry.margins.items())
        console.print(f"{safe(entry.name)}: {safe(words) or 'no margins'}")


def _named(title: str) -> Table:
    grid = table(title)
    grid.add_column("controller", overflow="fold", min_width=8)
    return grid
