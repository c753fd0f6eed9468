"""Search for the worst case of a controller: the arm within the tolerances that it holds least, margins and radius."""

from __future__ import annotations

import argparse
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from rich.console import Console

from ..codec import to_json
from ..documents.files import REPORT, ROBUSTNESS, TRAJECTORIES
from ..documents.robustness import Robustness, margin_words, radius_rows, robustness_remarks, verdict_words
from ..documents.wording import SHOWN, number
from . import options
from .evaluate import folder_name
from .guard import EXIT_CODES, EXIT_INCOMPLETE, EXIT_OK
from .judged import shown_code
from .tables import safe, table, terminal
from .values import MOST, Parser, natural
from .values import number as value

EXAMPLES = """examples:
  python -m orchestrator.robustness my_controller.fmu                   some 2,000 simulations
  python -m orchestrator.robustness my_controller.fmu --budget 20000    a long search
  python -m orchestrator.robustness my_controller.fmu --only B6 --no-list --budget 300

A failure that is found is a proof, which its command repeats; none found is none. The same command goes on with an
interrupted search.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    bench, controller = options.benchmark(given), options.controller(given)
    options.announce(bench, controller)
    folder = given.output_dir or Path("runs") / f"{folder_name(bench, controller, given.only)}-robustness"
    found = bench.robustness(
        controller,
        budget=given.budget,
        minutes=given.minutes,
        protocol=given.protocol,
        only=given.only,
        from_list=not given.no_list,
        folder=folder,
        recordings=not given.no_report,
        on_progress=_progress,
    )
    written = [ROBUSTNESS]
    if not given.no_report:
        written += [TRAJECTORIES, *pictured(found, folder)]
    told(found, given.json)
    print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)
    return shown_code(found) or (EXIT_OK if found.complete and not found.failures else EXIT_INCOMPLETE)


def pictured(found: Robustness, folder: Path) -> list[str]:
    """Write what shows the answer; the names of these files."""
    found.report(folder / REPORT, folder)
    return [REPORT]


def told(found: Robustness, as_json: bool) -> None:
    """Print the answer of a search, as tables or as it stands in its file."""
    if as_json:
        print(to_json(found))
    else:
        show(found, terminal())


def _progress(stage: str, simulations: int, worst: Mapping[str, float | None]) -> None:
    known = (f"{name} {number(height, 1e3)} mm" for name, height in worst.items() if name in ("B5", "B7"))
    settling = (f"{name} {number(height)} s" for name, height in worst.items() if name == "B6")
    print(f"{simulations:6d} simulations  {stage:24}{'  '.join([*settling, *known])}", file=sys.stderr)


def show(found: Robustness, console: Console) -> None:
    """Print what was found, and the commands that repeat it."""
    console.print(
        f"[bold]{safe(found.benchmark)}[/bold]  worst case of [bold]{safe(found.controller.file)}[/bold], "
        f"{found.simulations} simulations from the protocol {safe(found.protocol)}, seed {found.seed}\n"
    )
    grid = table("Largest values found")
    for heading in ("", "mean", "of the list", "largest"):
        grid.add_column(heading, justify="right" if heading else "left", no_wrap=True)
    for name, entry in found.criteria.items():
        factor, unit = SHOWN[entry.unit]
        figures = (number(each, factor) for each in (entry.value, entry.protocol, entry.worst_case.value))
        grid.add_row(f"{name} \\[{unit}]", *figures)
    grid.add_row("V", f"[bold]{number(found.cost)}[/bold]", number(found.protocol_cost), "")
    console.print(grid)
    for name, requirement in found.requirements.items():
        console.print(
            f"{name}  {safe(verdict_words(requirement))}", style="red" if requirement.passed is False else None
        )
    for name, margin in found.margins.items():
        console.print(f"{safe(name):12}{margin_words(name, margin)}")
    for name, words in radius_rows(found.radius):
        console.print(f"{name}: {words} the tolerances of Table 1")
    commands = {name: entry.worst_case.command for name, entry in found.criteria.items() if entry.worst_case.command}
    commands |= {name: each.command for name, each in found.requirements.items() if each.passed is False}
    commands |= {f"margin {name}": margin.command for name, margin in found.margins.items() if margin.command}
    console.print("\nto repeat these:")
    for name, command in commands.items():
        console.print(f"{name}\n  {safe(command)}", soft_wrap=True, highlight=False)
    for remark in robustness_remarks(found):
        console.print(f"[yellow]{safe(remark)}[/yellow]")


def _parser() -> argparse.ArgumentParser:
    parser = Parser("robustness", "Search for the worst case of a controller.", EXAMPLES + "\n" + EXIT_CODES)
    options.add_controller(parser)
    options.add_protocol(parser)
    parser.set_defaults(protocol="strict")
    parser.add_argument(
        "--budget", type=natural(1), default=2000, metavar="N", help="simulations, not exceeded (default: 2000)"
    )
    parser.add_argument(
        "--minutes",
        type=value(most=MOST, positive=True),
        default=math.inf,
        metavar="M",
        help="time after which nothing new is searched (default: none)",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="what to search for: B5, B6, B7, or a test such as delay_2; may be given again (default: all)",
    )
    parser.add_argument("--no-list", action="store_true", help="begin with the nominal system, not with the list")
    options.add_jobs(parser)
    options.add_cluster(parser)
    parser.add_argument(
        "--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/CONTROLLER-strict-robustness)"
    )
    parser.add_argument("--no-report", action="store_true", help="write no report.html, and record nothing for it")
    parser.add_argument("--json", action="store_true", help="print robustness.json instead of tables")
    return parser
