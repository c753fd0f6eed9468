"""Make the report of a run again, or figures and tables of it; nothing is simulated."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from ..api.evaluation import Evaluation
from ..codec import to_json
from ..reporting.run import load_run
from .guard import EXIT_OK
from .outputs import add_options, check_options, write_outputs
from .tables import show_results, terminal
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.report runs/DiagonalPID-paper              report.html again
  python -m orchestrator.report runs/DiagonalPID-paper --figures    and the paper's figures

exit codes: 0 written, 1 something cannot be written, 2 the folder holds no results"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("report", "Report on a finished evaluation, from the files it wrote.", EXAMPLES)
    parser.add_argument("run", type=Path, metavar="RUN", help="the run's folder, such as runs/DiagonalPID-paper")
    add_options(parser)
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    given = parser.parse_args(arguments)
    check_options(given)
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
