"""Make the report of a run again, or figures and tables of it; nothing is simulated.

python -m orchestrator.report runs/DiagonalPID-paper --figures
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path

from ..commands import EXIT_OK, guarded
from .outputs import add_options, write_outputs
from .run import load_run
from .terminal import show_document, terminal


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m orchestrator.report",
        description="Report on a finished evaluation, from the files it wrote.",
    )
    parser.add_argument("run", type=Path, metavar="RUN", help="the run's folder, such as runs/DiagonalPID-paper")
    add_options(parser)
    parser.add_argument("--json", action="store_true", help="print results.json instead of tables")
    options = parser.parse_args(arguments)
    run = load_run(options.run)
    if options.json:
        json.dump(run.document, sys.stdout, indent=1)
        print()
    else:
        show_document(run.document, terminal())
    written = write_outputs(run.folder, options)
    print(f"written to {run.folder}: {', '.join(written) or 'nothing'}", file=sys.stderr)
    return EXIT_OK


if __name__ == "__main__":
    raise SystemExit(guarded(main))
