"""The spread over several seeds as tables for a terminal."""

from __future__ import annotations

from rich.console import Console

from ..reporting.reasons import spread_reasons
from ..reporting.spread import Spread, spread_remarks, statistic_rows
from .tables import NARROW, safe, show_reasons, table


def show_spread(spread: Spread, console: Console) -> None:
    """Print mean, standard deviation, smallest and largest values, for how many seeds each requirement holds, and what
    does not count."""
    seeds = ", ".join(str(score.seed) for score in spread.seeds)
    console.print(
        f"[bold]{safe(spread.benchmark)}[/bold]  protocol {safe(spread.protocol)}  "
        f"controller [bold]{safe(spread.controller.file)}[/bold]\nseeds {seeds or 'none'}\n"
    )
    grid = table("Over the seeds")
    grid.add_column("", no_wrap=True)
    if console.width >= NARROW:
        grid.add_column("criterion", overflow="fold", min_width=9)
    for heading in ("mean", "s.d.", "smallest", "largest", "target"):
        grid.add_column(heading, justify="right", no_wrap=True)

    for name, title, figures in statistic_rows(spread):
        if name == "V":
            grid.add_section()
        grid.add_row(name, *((safe(title),) if console.width >= NARROW else ()), *figures)
    console.print(grid)
    for name, held in spread.requirements.items():
        console.print(f"{safe(name)} met with {held.seeds} of {held.of} seeds that it was judged with")
    show_reasons(spread_reasons(spread), console)
    for remark in spread_remarks(spread):
        console.print(f"[yellow]{safe(remark)}[/yellow]")
