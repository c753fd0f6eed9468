"""The scorecard as tables for a terminal. Colour and width are rich's business: it honours NO_COLOR and pipes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from .tables import Document
from .wording import SHOWN, amplitude, connectors, loop_delay, number, remarks, requirement_rows

COLOURS = {"holds": "green", "fails": "red"}

MESSAGES = 3
"""Failed cases that are named; the others are counted."""

NARROW = 72
"""Characters a line, below which tables leave out what is not the result itself."""

FIGURES = ("value", "target", "paper", "of V", "worst")
"""Of a criterion, the most important first."""


def show_document(results: Document, console: Console) -> None:
    """Print the scorecard of ``results.json``."""
    console.print(
        f"[bold]{results['benchmark']}[/bold]  protocol {results['protocol']}  "
        f"controller [bold]{escape(results['controller']['file'])}[/bold]\n"
        f"seed {results['seed']}\n{escape(loop_delay(results['loop_delay']))}\n"
        f"connectors {connectors(results)}\n"
    )
    console.print(_criteria(results, console.width < NARROW))
    console.print(_requirements(results))
    _failures(results, console)
    for remark in remarks(results):
        console.print(f"[yellow]{escape(remark)}[/yellow]")


def terminal(stderr: bool = False) -> Console:
    """Where all commands print to. Names like ":x:" stay what they are."""
    return Console(stderr=stderr, emoji=False)


def table(title: str) -> Table:
    """An empty table in the common look: seven columns of figures fit into 80 characters."""
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)


def _criteria(results: Document, narrow: bool) -> Table:
    grid = table("Worst case, averaged over the workspace")
    grid.add_column("", no_wrap=True)
    grid.add_column("criterion", overflow="fold", min_width=9)
    figures = FIGURES[:2] if narrow else FIGURES
    for heading in figures:
        grid.add_column(heading, justify="right", no_wrap=True)
    grid.add_column("where", overflow="fold", min_width=13)
    for name, entry in results["criteria"].items():
        factor, unit = SHOWN[entry["unit"]]
        worst = entry["worst_case"]
        shown = (
            _coloured(entry, factor),
            number(entry["target"] * factor),
            number(entry["paper"] * factor),
            number(entry["share"]),
            number(_times(worst["value"] if worst else None, factor)),
        )
        where = f"c{worst['configuration']:02d}.{worst['system']}" if worst else "-"
        grid.add_row(name, f"{entry['title']} \\[{unit}]", *shown[: len(figures)], where)
    grid.add_section()
    cost = results["rules"]["cost"]
    total = (f"[bold]{number(results['cost'])}[/bold]", number(cost["target"]), number(cost["paper"]))
    grid.add_row("V", "Cost, eq. (15)", *total[: len(figures)])
    return grid


def _requirements(results: Document) -> Table:
    limit = results["rules"]["stability"]["limit_cycle"]
    grid = table(f"Stability: limit cycle below {limit * 1e6:g} µm")
    grid.add_column("", no_wrap=True)
    grid.add_column("requirement", overflow="fold", min_width=11)
    grid.add_column("verdict", no_wrap=True)
    grid.add_column("largest", justify="right", no_wrap=True)
    grid.add_column("where", overflow="fold", min_width=9)
    for row in requirement_rows(results):
        colour = COLOURS.get(row["verdict"])
        word = f"[{colour}]{row['verdict']}[/{colour}]" if colour else row["verdict"]
        grid.add_row(row["name"], row["title"], word, amplitude(row), row["worst_case"] or "-")
    return grid


def _failures(results: Document, console: Console) -> None:
    failed = [case for case in results["cases"] if case["status"] != "done"]
    for case in failed[:MESSAGES]:
        console.print(f"{case['id']}: [red]{case['status']}[/red]: {escape(case['message'])}")
    if len(failed) > MESSAGES:
        console.print(f"... and {len(failed) - MESSAGES} more; see cases.csv.")


def _times(value: float | None, factor: float) -> float | None:
    return None if value is None else value * factor


def _coloured(entry: Mapping[str, Any], factor: float) -> str:
    if entry["value"] is None:
        return "[red]-[/red]"
    colour = "green" if entry["value"] <= entry["target"] else "red"
    return f"[{colour}]{number(entry['value'] * factor)}[/{colour}]"
