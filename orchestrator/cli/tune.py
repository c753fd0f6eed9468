"""Tune the parameters of a controller FMU: a search for those that make V small while A1 to A3 hold."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from rich.console import Console

from ..benchmark.protocol import names
from ..codec import to_json
from ..documents.files import REPORT, TUNING
from ..documents.tuning import Tuning, best_rows, parameter_rows, tuning_remarks
from ..documents.wording import number
from ..search.candidates import Trial
from ..search.proposals import SAMPLERS
from ..study.tune import BEST
from ..text import printable
from . import options
from .evaluate import folder_name
from .guard import EXIT_CODES, EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK
from .tables import safe, table, terminal
from .values import Parser, natural, variation

EXAMPLES = """examples:
  python -m orchestrator.tune my_controller.fmu --vary K_p[1]=20:80:log --vary z_p[1]=0.8:0.99
  python -m orchestrator.tune my_controller.fmu --vary K_p[1]=20:80:log --trials 500 --robust 2000

The same command goes on with an interrupted search, and comes to the same answer. best.toml is for --parameters.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    bench, controller = options.benchmark(given), options.controller(given)
    options.announce(bench, controller)
    folder = given.output_dir or Path("runs") / f"{folder_name(bench, controller, ())}-tuning"
    found = bench.tune(
        controller,
        options.varied(given.vary),
        trials=given.trials,
        objective=given.objective,
        robust=given.robust,
        sampler=given.sampler,
        search_seed=given.search_seed,
        folder=folder,
        on_trial=_progress(),
    )
    written = [TUNING] if found.best is None else [TUNING, BEST]
    written += [] if given.no_report else pictured(found, folder)
    told(found, given.json)
    print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)
    if found.best is None:
        return EXIT_INCOMPLETE
    return EXIT_NOT_JUDGED if found.best.strict_not_judged else EXIT_OK


def pictured(found: Tuning, folder: Path) -> list[str]:
    """Write what shows the answer; the names of these files."""
    found.report(folder / REPORT)
    return [REPORT]


def told(found: Tuning, as_json: bool) -> None:
    """Print the answer, as tables or as it stands in its file."""
    if as_json:
        print(to_json(found))
    else:
        show(found, terminal())


def _progress() -> Callable[[Trial, int, int], None]:
    best: list[Trial] = []

    def say(trial: Trial, done: int, total: int) -> None:
        best[:] = sorted([*best, trial], key=lambda each: each.objective)[:1]
        came_to = trial.message or f"V = {number(trial.cost)}" + (" and worse" if trial.cut_short else "")
        lead = f"best so far: objective {number(best[0].objective)}, V = {number(best[0].cost)}"
        print(f"{done:5d} of {total}  {printable(came_to):24}  {lead}", file=sys.stderr)

    return say


def show(found: Tuning, console: Console) -> None:
    """Print the best candidate beside what the search began with, and what tells whether it is luck."""
    console.print(
        f"[bold]{safe(found.benchmark)}[/bold]  tuning of [bold]{safe(found.controller.file)}[/bold], "
        f"{len(found.trials)} trials ({found.sampler}) in the protocol {safe(found.objective)}, {len(found.judged)} "
        f"candidates in {safe(found.protocol)}\n"
    )
    grid = table("Parameters")
    for heading in ("", "start", "best", "range", "importance"):
        grid.add_column(heading, justify="right" if heading else "left", overflow="fold")
    for name, start, best, *rest in parameter_rows(found):
        grid.add_row(safe(name), start, f"[bold]{best}[/bold]", *rest)
    console.print(grid)
    for where, value in best_rows(found):
        console.print(f"V in {safe(where):36} [bold]{value}[/bold]")
    for remark in tuning_remarks(found):
        console.print(f"[yellow]{safe(remark)}[/yellow]")


def _parser() -> argparse.ArgumentParser:
    parser = Parser("tune", "Tune the parameters of a controller FMU.", EXAMPLES + "\n" + EXIT_CODES)
    options.add_controller(parser)
    options.add_protocol(parser)
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        type=variation,
        metavar="NAME=LOW:HIGH[:log]",
        help="a parameter and its range, in the unit the FMU has for it; may be given again",
    )
    parser.add_argument("--trials", type=natural(1), default=200, metavar="N", help="candidates (default: 200)")
    parser.add_argument(
        "--objective",
        default="tuning",
        metavar="NAME",
        help=f"the short protocol that candidates are tried in, one of: {', '.join(names())}; or a protocol file "
        "(default: tuning)",
    )
    parser.add_argument(
        "--robust",
        type=natural(),
        default=0,
        metavar="N",
        help="search for the worst case of the best candidates, with N simulations each, at least the 920 of "
        "the strict list, and count what is found "
        "(default: 0)",
    )
    parser.add_argument("--sampler", choices=SAMPLERS, default="cmaes", help="of Optuna (default: cmaes)")
    parser.add_argument("--search-seed", type=natural(), default=1, metavar="N", help="of the sampler (default: 1)")
    options.add_jobs(parser)
    options.add_cluster(parser)
    parser.add_argument(
        "--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/CONTROLLER-paper-tuning)"
    )
    parser.add_argument("--no-report", action="store_true", help="write no report.html")
    parser.add_argument("--json", action="store_true", help="print tuning.json instead of tables")
    return parser
