"""Compare finished evaluations: a leaderboard in the terminal and as a page."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from ..codec import to_json
from ..errors import InputError
from ..reporting import compare_page
from ..reporting.comparison import compare, comparison_document
from ..reporting.files import prepare_folder, write_text
from ..reporting.run import Run, load_run
from ..text import printable
from .comparison_tables import show_comparison
from .guard import EXIT_OK
from .tables import terminal
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.compare runs/DiagonalPID-paper runs/my_controller-paper
  python -m orchestrator.compare runs/*-paper --json

exit codes: 0 compared, 2 none of the folders holds results"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("compare", "Compare finished evaluations, from the files they wrote.", EXAMPLES)
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="a run's folder, such as runs/MyPID-paper")
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("runs") / "comparison",
        metavar="FOLDER",
        help="where to write compare.html (default: runs/comparison)",
    )
    parser.add_argument("--json", action="store_true", help="print the comparison as JSON instead of tables")
    given = parser.parse_args(arguments)
    groups = compare(_finished(given.runs))
    prepare_folder(given.output_dir)
    write_text(given.output_dir / compare_page.FILE, compare_page.compare_html(groups))
    if given.json:
        print(to_json(comparison_document(groups)))
    else:
        show_comparison(groups, terminal())
    print(f"written to {given.output_dir}: {compare_page.FILE}", file=sys.stderr)
    return EXIT_OK


def _finished(paths: Sequence[Path]) -> list[Run]:
    """The runs that are finished, with a note on each that is not; raises the last reason if there is none."""
    found: list[Run] = []
    last: InputError | None = None
    for path in paths:
        try:
            found.append(load_run(path))
        except InputError as problem:
            last = problem
            if len(paths) > 1:
                print(printable(f"left out: {problem}"), file=sys.stderr)
    if not found and last is not None:
        raise last
    return found
