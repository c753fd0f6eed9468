"""Show finished results again, from the files they wrote: tables, report, figures. Nothing is simulated."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ..codec import to_json
from ..documents.evaluation import Evaluation
from ..documents.files import REPORT
from ..documents.sweep import Sweep
from ..errors import InputError
from ..text import printable
from . import evaluation_files, output
from .loading import Loaded, finished
from .studies import sweep_files
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.report runs/DiagonalPID-paper              report.html again
  python -m orchestrator.report runs/DiagonalPID-paper --figures    and the paper's figures
  python -m orchestrator.report runs/DiagonalPID-strict-robustness  the report of a search, a tuning, several seeds, ...
  python -m orchestrator.report runs/DiagonalPID-paper --latex --no-report

exit codes: 0 written, 1 something cannot be written, 2 a folder holds no results, 3 written, but a requirement is not
judged since cases were skipped or lost"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("report", "Show finished results of any kind again, from the files they wrote.", EXAMPLES)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="FOLDER", help="a folder of results, such as runs/DiagonalPID-paper"
    )
    evaluation_files.add_options(parser)
    parser.add_argument("--no-report", action="store_true", help="write no report.html")
    output.add_dry_run(output.add_options(parser, "the JSON document"), "what would be written")
    given = parser.parse_args(arguments)
    evaluation_files.check_options(given)
    several: list[tuple[Loaded, Path]] = finished(given.runs)
    if given.json and len(several) > 1 and not given.dry_run:
        print(to_json([document.results if isinstance(document, Evaluation) else document for document, _ in several]))
    codes = []
    for number, (document, folder) in enumerate(several):
        other = not isinstance(document, Evaluation)
        if other and (given.figures or given.parquet or given.mat):
            raise InputError(f"{folder} holds no evaluation: only its report can be written.", "no-run", folder)
        place = folder if folder.is_dir() else folder.parent
        if given.dry_run:
            print(printable(f"{place}: {type(document).__name__} of {document.head.controller.file}"))
            continue
        written = _write(document, place, given.no_report)
        if isinstance(document, Evaluation):
            written += evaluation_files.write_outputs(document, place, given)
        if number and given.form == "csv":
            print()
        if not given.json or len(several) == 1:
            output.put(document, given, document.results if isinstance(document, Evaluation) else None)
        output.tell_written(place, written)
        codes.append(output.shown_code(document.completeness))
    return max(codes, default=0)


def _write(document: Loaded, folder: Path, without: bool) -> list[str]:
    written = (
        [] if without or not isinstance(document, Sweep) else list(sweep_files(document, folder, argparse.Namespace()))
    )
    if without:
        return written
    document.report(folder / REPORT, folder)
    return [*written, REPORT]
