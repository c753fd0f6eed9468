"""Files that a command writes of a run on request: the report, figures, tables for other tools; and their options."""

from __future__ import annotations

import argparse
import sys
from importlib.util import find_spec
from pathlib import Path

from ..documents.evaluation import Evaluation
from ..documents.files import FIGURES, MAT, PARQUET, write_bytes
from ..errors import InputError

# Imports inside functions: pyarrow and SciPy are loaded by those who need them.

NO_TRAJECTORIES = (
    "An evaluation without --no-report keeps trajectories, except of cases that hung, crashed or ended before the "
    "force."
)


def add_options(parser: argparse.ArgumentParser) -> None:
    """Options for files beside ``results.json`` and ``cases.csv``."""
    group = parser.add_argument_group("files of an evaluation")
    group.add_argument("--figures", action="store_true", help="write the paper's figures as PDF, SVG and PNG")
    group.add_argument("--parquet", action="store_true", help="write cases.parquet (needs pyarrow)")
    group.add_argument("--mat", action="store_true", help="write trajectories.mat, the recorded cases for MATLAB")


def check_options(given: argparse.Namespace) -> None:
    """Raise :class:`InputError` for a file that cannot be written, before anything is simulated."""
    if given.parquet and find_spec("pyarrow") is None:
        raise InputError("Parquet needs the package pyarrow: pip install pyarrow", "no-pyarrow")


def need_recordings(given: argparse.Namespace) -> bool:
    """Whether a file that was asked for shows trajectories."""
    return not given.no_report or given.figures or given.mat


def write_outputs(evaluation: Evaluation, folder: Path, given: argparse.Namespace) -> list[str]:
    """Write the files that were asked for, of an evaluation; returns the names of the files written.

    A file for which there are no data is left out, with a note.
    """
    written: list[str] = []
    left_out: list[str] = []
    if given.parquet:
        from ..documents.case_table import parquet_bytes

        write_bytes(folder / PARQUET, parquet_bytes(evaluation.results))
        written.append(PARQUET)
    if given.mat:
        if evaluation.recordings:
            from ..documents.run import mat_bytes

            write_bytes(folder / MAT, mat_bytes(evaluation))
        (written if evaluation.recordings else left_out).append(MAT)
    if given.figures:
        drawn, empty = evaluation.figures(folder / FIGURES)
        written += [f"{FIGURES}/{name}" for name in drawn]
        left_out += [f"{FIGURES}/{name}" for name in empty]
    if left_out:
        print(f"not written, as {folder} has no trajectories for them: {', '.join(left_out)}", file=sys.stderr)
        print(NO_TRAJECTORIES, file=sys.stderr)
    return written
