"""Make the report of a run again, or figures and tables of it; nothing is simulated."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..codec import to_json
from ..documents.documents import Document
from ..documents.evaluation import Evaluation
from ..documents.files import RESULTS
from ..documents.robustness import Robustness
from ..documents.run import load_run
from ..documents.sweep import Sweep
from ..documents.tuning import Tuning
from ..errors import InputError
from . import robustness, sweep, tune
from .guard import EXIT_OK
from .judged import shown_code
from .outputs import add_options, check_options, write_outputs
from .tables import show_results, terminal
from .values import Parser

OTHERS = ((Robustness, robustness), (Tuning, tune), (Sweep, sweep))
"""What is no evaluation, and the commands that show it."""

EXAMPLES = """examples:
  python -m orchestrator.report runs/DiagonalPID-paper              report.html again
  python -m orchestrator.report runs/DiagonalPID-paper --figures    and the paper's figures
  python -m orchestrator.report runs/DiagonalPID-strict-robustness  the report of a search, a tuning or a sweep

exit codes: 0 written, 1 something cannot be written, 2 the folder holds no results, 3 written, but a requirement of the
evaluation or the search is not judged since cases were skipped or lost"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("report", "Report on an evaluation, a search, a tuning or a sweep, from its files.", EXAMPLES)
    parser.add_argument("run", type=Path, metavar="RUN", help="the run's folder, such as runs/DiagonalPID-paper")
    add_options(parser)
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    given = parser.parse_args(arguments)
    check_options(given)
    if not (given.run / RESULTS).is_file():
        for kind, command in OTHERS:
            if (given.run / kind.FILE).is_file():
                return _of_another(kind, command, given)
    run = load_run(given.run)
    evaluation = Evaluation(run.results, run.recordings)
    folder = run.folder or given.run
    written = write_outputs(evaluation, folder, given)
    if given.json:
        print(to_json(evaluation.results))
    else:
        show_results(evaluation.results, terminal())
    print(f"written to {folder}: {', '.join(written) or 'nothing'}", file=sys.stderr)
    return shown_code(evaluation.results)


def _of_another(kind: type[Document], command: Any, given: argparse.Namespace) -> int:
    """Show again what another command than ``evaluate`` has found."""
    found = kind.load(given.run)
    if given.figures or given.parquet or given.mat:
        message = f"{given.run} holds no evaluation, and there is its report only."
        raise InputError(message, "no-run", given.run)
    written = [] if given.no_report else command.pictured(found, given.run)
    command.told(found, given.json)
    print(f"written to {given.run}: {', '.join(written) or 'nothing'}", file=sys.stderr)
    return shown_code(found) if isinstance(found, Robustness) else EXIT_OK
