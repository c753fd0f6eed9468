"""Make the report of a run again, or figures and tables of it; nothing is simulated."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from ..api.evaluation import Evaluation
from ..codec import to_json
from ..errors import InputError
from ..reporting.files import REPORT, RESULTS, ROBUSTNESS
from ..reporting.robustness import Robustness
from ..reporting.run import load_run
from .guard import EXIT_OK
from .outputs import add_options, check_options, write_outputs
from .robustness import told
from .tables import show_results, terminal
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.report runs/DiagonalPID-paper              report.html again
  python -m orchestrator.report runs/DiagonalPID-paper --figures    and the paper's figures
  python -m orchestrator.report runs/DiagonalPID-strict-robustness  the report of a search

exit codes: 0 written, 1 something cannot be written, 2 the folder holds no results"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser(
        "report", "Report on a finished evaluation or search for the worst case, from the files it wrote.", EXAMPLES
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="the run's folder, such as runs/DiagonalPID-paper")
    add_options(parser)
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    given = parser.parse_args(arguments)
    check_options(given)
    if (given.run / ROBUSTNESS).is_file() and not (given.run / RESULTS).is_file():
        return _of_search(given)
    run = load_run(given.run)
    evaluation = Evaluation(run.results, run.recordings)
    folder = run.folder or given.run
    written = write_outputs(evaluation, folder, given)
    if given.json:
        print(to_json(evaluation.results))
    else:
        show_results(evaluation.results, terminal())
    print(f"written to {folder}: {', '.join(written) or 'nothing'}", file=sys.stderr)
    return EXIT_OK


def _of_search(given: argparse.Namespace) -> int:
    """Make the page of a search for the worst case again."""
    found = Robustness.load(given.run)
    if given.figures or given.parquet or given.mat:
        raise InputError(f"{given.run} holds a search, of which there is its report only.", "no-run", given.run)
    if not given.no_report:
        found.report(given.run / REPORT, given.run)
    told(found, given.json)
    print(f"written to {given.run}: {'nothing' if given.no_report else REPORT}", file=sys.stderr)
    return EXIT_OK
