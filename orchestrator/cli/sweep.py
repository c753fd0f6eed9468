"""Try a grid of parameter values of a controller FMU: V and stability of every combination."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..codec import to_json
from ..documents.files import SWEEP, streamed, write_bytes, write_text
from ..documents.sweep import COLUMNS, Sweep, smallest_words, sweep_rows
from ..search.candidates import Trial
from . import options
from .evaluate import folder_name
from .guard import EXIT_CODES, EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK
from .tables import safe, table, terminal
from .values import Parser, grid_values

EXAMPLES = """examples:
  python -m orchestrator.sweep my_controller.fmu --vary K_p[1]=20:80:5
  python -m orchestrator.sweep my_controller.fmu --vary K_p[1]=20:80:5:log --vary z_p[1]=0.8,0.9,0.95

The same command goes on with an interrupted sweep.
"""
TABLE, PICTURE = "sweep.csv", "sweep.svg"


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    bench, controller = options.benchmark(given), options.controller(given)
    options.announce(bench, controller)
    folder = given.output_dir or Path("runs") / f"{folder_name(bench, controller, ())}-sweep"
    values = options.varied(given.vary)
    found = bench.sweep(controller, values, objective=given.protocol, folder=folder, on_trial=_progress)
    written = [SWEEP, *pictured(found, folder)]
    told(found, given.json)
    print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)
    if not all(trial.judged for trial in found.trials):
        return EXIT_NOT_JUDGED
    return EXIT_INCOMPLETE if any(trial.message for trial in found.trials) else EXIT_OK


def pictured(found: Sweep, folder: Path) -> list[str]:
    """Write what shows the answer; the names of these files."""
    write_text(folder / TABLE, found.csv())
    if len(found.varied) > 2:
        return [TABLE]
    from ..documents.figures import FORMATS  # Matplotlib takes as long to load as the rest of the command

    figure = found.plot()
    write_bytes(folder / PICTURE, streamed(lambda file: figure.savefig(file, format="svg", **FORMATS["svg"])))
    return [TABLE, PICTURE]


def told(found: Sweep, as_json: bool) -> None:
    """Print the answer, as a table or as it stands in its file."""
    if as_json:
        print(to_json(found))
        return
    console = terminal()
    console.print(f"[bold]{safe(found.controller.file)}[/bold]  protocol {safe(found.protocol)}  seed {found.seed}\n")
    grid = table("Every combination")
    for heading in (*found.values, *COLUMNS):
        grid.add_column(safe(heading), justify="right", overflow="fold")
    for row in sweep_rows(found):
        grid.add_row(*map(safe, row))
    console.print(grid)
    console.print(safe(smallest_words(found)))


def _progress(trial: Trial, done: int, total: int) -> None:
    print(f"{done:5d} of {total}", file=sys.stderr)


def _parser() -> argparse.ArgumentParser:
    parser = Parser("sweep", "Try a grid of parameter values of a controller FMU.", EXAMPLES + "\n" + EXIT_CODES)
    options.add_controller(parser)
    options.add_protocol(parser, default="tuning")
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        type=grid_values,
        metavar="NAME=LOW:HIGH:COUNT[:log]",
        help="a parameter and its values, evenly spaced or as a list such as 0.8,0.9,0.95, in the unit the FMU has for "
        "it; may be given again: every combination is tried",
    )
    options.add_jobs(parser)
    options.add_cluster(parser)
    parser.add_argument(
        "--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/CONTROLLER-tuning-sweep)"
    )
    parser.add_argument("--json", action="store_true", help="print sweep.json instead of a table")
    return parser
