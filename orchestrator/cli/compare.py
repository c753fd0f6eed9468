"""Compare finished results of any kind: leaderboards in the terminal and as a page."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from ..documents import compare_page
from ..documents.comparison import compare
from ..documents.files import FIGURES, prepare_folder
from ..text import printable
from . import output
from .loading import finished
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.compare runs/DiagonalPID-paper runs/my_controller-paper
  python -m orchestrator.compare runs/*-paper --json
  python -m orchestrator.compare runs/*-paper runs/*-robustness --latex --figures
  python -m orchestrator.compare runs/*-paper-seeds runs/*-robustness

exit codes: 0 compared, 2 none of the folders holds results, 3 compared, but a requirement is not judged in one of them
since cases were skipped or lost"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("compare", "Compare finished results of any kind, from the files they wrote.", EXAMPLES)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="FOLDER", help="a folder of results, such as runs/MyPID-paper"
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("runs") / "comparison",
        metavar="FOLDER",
        help="where to write compare.html (default: runs/comparison)",
    )
    output.add_dry_run(output.add_options(parser, "the comparison as JSON"), "what would be compared")
    parser.add_argument(
        "--figures", action="store_true", help="write figures for a paper as PDF, SVG and PNG, 88 or 180 mm wide"
    )
    given = parser.parse_args(arguments)
    listed = finished(given.runs)
    comparison = compare([(document, path) for document, path in listed])
    if given.dry_run:
        print("\n".join(printable(f"{group.title}: {len(group.entries)}") for group in comparison))
        return 0
    prepare_folder(given.output_dir)
    comparison.report(given.output_dir / compare_page.FILE)
    written = [compare_page.FILE]
    if given.figures:
        from ..documents.comparison_figures import write_comparison  # Matplotlib, which takes a second

        drawn, empty = write_comparison(comparison.named, given.output_dir / FIGURES)
        written += [f"{FIGURES}/{name}" for name in drawn]
        if empty:
            print(f"not written, since there are no data for them: {', '.join(empty)}", file=sys.stderr)
    output.put(comparison, given, comparison.document())
    output.tell_written(given.output_dir, written)
    return max(output.shown_code(document.completeness) for document, _ in listed)
