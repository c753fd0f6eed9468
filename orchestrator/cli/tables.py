"""The scorecard as tables for a terminal. Colour and width are left to rich, which honours NO_COLOR and pipes."""

from __future__ import annotations

import codecs
import io
import sys
from collections.abc import Iterable

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.markup import escape
from rich.table import Table

from ..benchmark.certificate import CaseEnding
from ..benchmark.results import CaseResult, CriterionScore, Results
from ..loop.trajectory import Status
from ..reporting.reasons import Reason, reasons
from ..reporting.repeat import simulate_command
from ..reporting.wording import SHOWN, computing_time, connectors, figure, loop_delay, number, remarks, requirement_rows
from ..text import printable

COLOURS = {"met": "green", "not met": "red", "not judged": "yellow"}

MESSAGES = 3
"""Failed cases that are named; the others are counted."""

NARROW = 72
"""Characters per line, below which tables leave out what is not the result itself."""

TINY = 50
"""Characters per line, below which any column may be folded."""

LOOK_ALIKES = {"µ": "u", "×": "x", "°": " deg", "…": "..."}
"""What stands for a character that the terminal's encoding does not have; for all others, a question mark."""

COLUMNS = ("value", "target", "paper", "of V", "worst")
"""What is shown of a criterion, the most important first."""


def terminal(stderr: bool = False) -> Console:
    """Where all commands print to. Names like ":x:" stay what they are; see :data:`LOOK_ALIKES`."""
    codecs.register_error("look-alike", _look_alike)
    stream = sys.stderr if stderr else sys.stdout
    if isinstance(stream, io.TextIOWrapper):
        stream.reconfigure(errors="look-alike")
    return Console(stderr=stderr, emoji=False)


def show_results(results: Results, console: Console) -> None:
    """Print the scorecard, the cases that failed with the commands that repeat them, and remarks."""
    console.print(
        f"[bold]{safe(results.benchmark)}[/bold]  protocol {safe(results.protocol)}  "
        f"controller [bold]{safe(results.controller.file)}[/bold]\n"
        f"seed {results.seed}\n{safe(loop_delay(results.loop_delay))}\n"
        f"computing time {computing_time(results)}\n"
        f"connectors {safe(connectors(results.controller))}\n"
    )
    console.print(_criteria(results, console.width))
    console.print(_requirements(results, console.width))
    _failures(results, console)
    for remark in remarks(results):
        console.print(f"[yellow]{safe(remark)}[/yellow]")


def safe(text: str) -> str:
    """Text of a stranger for the console: without control characters, and without markup."""
    return escape(printable(text))


def _look_alike(error: UnicodeError) -> tuple[str, int]:
    assert isinstance(error, UnicodeEncodeError)
    return "".join(LOOK_ALIKES.get(c, "?") for c in error.object[error.start : error.end]), error.end


def table(title: str) -> Table:
    """An empty table in the common look: seven columns of figures fit into 80 characters."""
    return Table(title=title, title_justify="left", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)


def _criteria(results: Results, width: int) -> Table:
    grid = table("Worst case, averaged over the workspace")
    grid.add_column("", no_wrap=True)
    grid.add_column("criterion", overflow="fold", min_width=9)
    figures = COLUMNS[:2] if width < NARROW else COLUMNS
    for heading in figures:
        grid.add_column(heading, justify="right", no_wrap=True)
    grid.add_column("where", overflow="fold", min_width=None if width < TINY else 13)
    for name, score in results.criteria.items():
        worst = score.worst_case
        shown = (
            _coloured(score),
            figure(score, score.target),
            figure(score, score.paper),
            number(score.share),
            figure(score, worst.value if worst else None),
        )
        where = f"c{worst.configuration:02d}.{safe(worst.system)}" if worst else "-"
        grid.add_row(name, f"{safe(score.title)} \\[{SHOWN[score.unit][1]}]", *shown[: len(figures)], where)
    grid.add_section()
    cost = results.rules.cost
    total = (f"[bold]{number(results.cost)}[/bold]", number(cost.target), number(cost.paper))
    grid.add_row("V", "Cost, eq. (15)", *total[: len(figures)])
    return grid


def _requirements(results: Results, width: int) -> Table:
    grid = table(f"Stability: limit cycle below {results.rules.stability.limit_cycle * 1e6:g} µm")
    grid.add_column("", no_wrap=True)
    grid.add_column("requirement", overflow="fold", min_width=None if width < TINY else 11)
    grid.add_column("verdict", no_wrap=True)
    grid.add_column("largest", justify="right", no_wrap=width >= TINY, overflow="fold")
    grid.add_column("where", overflow="fold", min_width=None if width < TINY else 9)
    for row in requirement_rows(results):
        word = f"[{COLOURS[row.verdict]}]{row.verdict}[/{COLOURS[row.verdict]}]"
        grid.add_row(row.name, row.title, word, row.amplitude, safe(row.judged.worst_case or "-"))
    return grid


def show_endings(cases: Iterable[tuple[str, CaseResult | CaseEnding]], file: str, console: Console) -> list[str]:
    """Print the first of the named cases that did not end with ``done``, with status and message; all are in ``file``.
    Returns the names of those printed that were run."""
    failed = [(name, case) for name, case in cases if case.status is not Status.DONE]
    for name, case in failed[:MESSAGES]:
        console.print(f"{safe(name)}: [red]{case.status.value}[/red]: {safe(case.message)}")
    if len(failed) > MESSAGES:
        console.print(f"... and {len(failed) - MESSAGES} more; see {file}.")
    return [name for name, case in failed[:MESSAGES] if case.status is not Status.SKIPPED]


def show_reasons(lines: Iterable[Reason], console: Console) -> None:
    """Print why requirements are not met or not judged. The lines are not wrapped: they hold commands to be copied."""
    for line in lines:
        console.print(safe(str(line)), soft_wrap=True, highlight=False)


def _failures(results: Results, console: Console) -> None:
    """The first cases that failed, why requirements are not met, and the commands that repeat the other worst cases."""
    failed = show_endings(((case.id, case) for case in results.cases), "cases.csv", console)
    show_reasons(reasons(results), console)
    shown = {entry.tally.first for entry in results.stability.values() if entry.passed is False}
    worst = [row.judged.worst_case for row in requirement_rows(results) if row.judged.passed is False]
    rest = [id for id in dict.fromkeys([*failed, *worst]) if id and id not in shown]
    if rest:
        console.print("to repeat the other cases above:")
    for id in rest:
        console.print(f"  {safe(simulate_command(results, id))}", soft_wrap=True, highlight=False)


def _coloured(score: CriterionScore) -> str:
    if score.value is None:
        return "[red]-[/red]"
    colour = "green" if score.value <= score.target else "red"
    return f"[{colour}]{figure(score, score.value)}[/{colour}]"
