"""Compare finished evaluations: a leaderboard in the terminal and as a page.

python -m orchestrator.compare runs/DiagonalPID-paper runs/MyController-paper
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from .commands import EXIT_OK, guarded
from .report import compare_page
from .report.comparison import compare, comparison_document
from .report.files import prepare_folder, write_text
from .report.leaderboard import show_comparison
from .report.run import load_run
from .report.terminal import terminal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m orchestrator.compare",
        description="Compare finished evaluations, from the files they wrote.",
    )
    parser.add_argument("runs", nargs="+", type=Path, metavar="RUN", help="a run's folder, such as runs/MyPID-paper")
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("runs") / "comparison",
        metavar="FOLDER",
        help="where to write compare.html (default: runs/comparison)",
    )
    parser.add_argument("--json", action="store_true", help="print the comparison as JSON instead of tables")
    options = parser.parse_args(arguments)
    groups = compare([load_run(path) for path in options.runs])
    prepare_folder(options.output_dir)
    write_text(options.output_dir / compare_page.FILE, compare_page.compare_html(groups))
    if options.json:
        json.dump(comparison_document(groups), sys.stdout, indent=1)
        print()
    else:
        show_comparison(groups, terminal())
    print(f"written to {options.output_dir}: {compare_page.FILE}", file=sys.stderr)
    return EXIT_OK


if __name__ == "__main__":
    raise SystemExit(guarded(main))
