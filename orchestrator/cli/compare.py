"""Compare finished evaluations: a leaderboard in the terminal and as a page."""

from __future__ import annotations

import sys
from collections.abc import Callable, Sequence
from pathlib import Path

from ..codec import to_json
from ..documents import compare_page, paper_tables
from ..documents.beside import beside, beside_document, compare_spreads
from ..documents.comparison import compare, comparison_document
from ..documents.files import FIGURES, RESULTS, ROBUSTNESS, SPREAD, prepare_folder, write_text
from ..documents.robustness import Robustness
from ..documents.run import Run, load_run
from ..documents.spread import Spread
from ..errors import InputError
from ..text import printable
from .comparison_tables import show_comparison, show_spreads, show_worst
from .judged import shown_code
from .tables import terminal
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
    parser = Parser("compare", "Compare finished evaluations, from the files they wrote.", EXAMPLES)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="RUN", help="a folder of evaluate or robustness, such as runs/MyPID-paper"
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("runs") / "comparison",
        metavar="FOLDER",
        help="where to write compare.html (default: runs/comparison)",
    )
    shown = parser.add_mutually_exclusive_group()
    shown.add_argument("--json", action="store_true", help="print the comparison as JSON instead of tables")
    for form, words in (("latex", "LaTeX (booktabs)"), ("markdown", "Markdown"), ("csv", "CSV")):
        shown.add_argument(
            f"--{form}", action="store_const", const=form, dest="form", help=f"print the tables for a paper, in {words}"
        )
    parser.add_argument(
        "--figures", action="store_true", help="write figures for a paper as PDF, SVG and PNG, 88 or 180 mm wide"
    )
    given = parser.parse_args(arguments)
    found = _finished(given.runs)
    groups = compare([each for each, _ in found if isinstance(each, Run)])
    spreads = compare_spreads([(each, path) for each, path in found if isinstance(each, Spread)])
    worst = beside([(each, path) for each, path in found if isinstance(each, Robustness)], groups, spreads)
    prepare_folder(given.output_dir)
    write_text(given.output_dir / compare_page.FILE, compare_page.compare_html(groups, spreads, worst))
    if given.json:
        print(to_json({**comparison_document(groups), **beside_document(spreads, worst)}))
    elif given.form:
        print(paper_tables.FORMATS[given.form](paper_tables.tables(groups, spreads, worst)))
    else:
        show_comparison(groups, terminal())
        show_spreads(spreads, terminal())
        show_worst(worst, terminal())
    written = [compare_page.FILE]
    if given.figures:
        from ..documents.comparison_figures import write_comparison  # Matplotlib, which takes a second

        drawn, empty = write_comparison(groups, spreads, worst, given.output_dir / FIGURES)
        written += [f"{FIGURES}/{name}" for name in drawn]
        if empty:
            print(f"not written, as there is nothing to show in them: {', '.join(empty)}", file=sys.stderr)
    print(f"written to {given.output_dir}: {', '.join(written)}", file=sys.stderr)
    return max(shown_code(each.results if isinstance(each, Run) else each) for each, _ in found)


def _finished(paths: Sequence[Path]) -> list[tuple[Run | Spread | Robustness, Path]]:
    """What is finished, with a note on each path that holds nothing; raises the last reason if there is none."""
    found: list[tuple[Run | Spread | Robustness, Path]] = []
    last: InputError | None = None
    for path in paths:
        kinds = [load for name, load in LOADERS.items() if path.name == name or (path / name).is_file()]
        for load in kinds or [load_run]:
            try:
                found.append((load(path), path))
            except InputError as problem:
                last = problem
                if len(paths) > 1:
                    print(printable(f"left out: {problem}"), file=sys.stderr)
    if not found and last is not None:
        raise last
    return found


LOADERS: dict[str, Callable[[Path], Run | Spread | Robustness]] = {
    RESULTS: load_run,
    SPREAD: Spread.load,
    ROBUSTNESS: Robustness.load,
}
"""What a folder may hold, by the name of the file."""
