"""What is made of a run on request: the report, figures, tables for other tools. Options and files in one place."""

from __future__ import annotations

import argparse
import json
import sys
from importlib.util import find_spec
from pathlib import Path

from ..errors import InputError
from .files import CASES, FIGURES, MAT, PARQUET, REPORT, RESULTS, TRAJECTORIES, remove, write_bytes, write_text
from .report_page import report_html
from .run import load_run
from .tables import Document, parquet_bytes

NO_TRAJECTORIES = (
    "An evaluation without --no-report keeps trajectories, but of no case that hung, crashed or ended before its force."
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options of what is written beside ``results.json`` and ``cases.csv``."""
    group = parser.add_argument_group("report")
    group.add_argument("--no-report", action="store_true", help="write no report.html")
    group.add_argument("--figures", action="store_true", help="write the paper's figures as PDF, SVG and PNG")
    group.add_argument("--parquet", action="store_true", help="write cases.parquet (needs pyarrow)")
    group.add_argument("--mat", action="store_true", help="write trajectories.mat, the recorded cases for MATLAB")


def check_options(options: argparse.Namespace) -> None:
    """Raise :class:`InputError` for what cannot be written here, before anything is simulated for it."""
    if options.parquet and find_spec("pyarrow") is None:
        raise InputError("--parquet needs the package pyarrow: pip install pyarrow")


def need_recordings(options: argparse.Namespace) -> bool:
    """Whether anything that was asked for shows trajectories."""
    return not options.no_report or options.figures or options.mat


def remove_outdated(folder: Path, document: Document) -> bool:
    """Before the results ``document`` are written into ``folder``: remove what was made of other ones that are there.

    Returns whether there were any. What is kept belongs to ``document``, whenever the process is interrupted.
    """
    try:
        if _essence(load_run(folder).document) == _essence(json.loads(json.dumps(document))):
            return False
    except InputError:  # none there, or none that can be read
        if not (folder / RESULTS).exists():
            return False
    for name in (RESULTS, CASES, TRAJECTORIES, REPORT, PARQUET, MAT, FIGURES):
        remove(folder / name)
    return True


def _essence(document: Document) -> Document:
    """The results without when and where they were computed."""
    return {name: value for name, value in document.items() if name not in ("timing", "environment")}


def write_outputs(folder: Path, options: argparse.Namespace) -> list[str]:
    """Make what ``options`` ask for of the run in ``folder``; returns the names of the files written.

    What was asked for and has nothing to show is left out, and told.
    """
    check_options(options)
    run = load_run(folder)
    written: list[str] = []
    left_out: list[str] = []
    if options.parquet:
        write_bytes(run.folder / PARQUET, parquet_bytes(run.document))
        written.append(PARQUET)
    if options.mat:
        if run.recordings:
            from .mat import mat_bytes

            write_bytes(run.folder / MAT, mat_bytes(run))
        (written if run.recordings else left_out).append(MAT)
    if options.figures:
        from .figures import write_figures

        drawn, empty = write_figures(run)
        written += drawn
        left_out += empty
    if not options.no_report:
        write_text(run.folder / REPORT, report_html(run))
        written.append(REPORT)
    if left_out:
        print(f"not written, as {run.folder} has no trajectories for them: {', '.join(left_out)}", file=sys.stderr)
        print(NO_TRAJECTORIES, file=sys.stderr)
    return written
