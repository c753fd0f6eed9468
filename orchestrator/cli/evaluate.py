"""Evaluate a controller FMU: run a protocol over all cores, print the scorecard, write the results."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from ..api.benchmark import Benchmark
from ..documents.evaluation import Evaluation
from ..documents.files import CASES, FIGURES, MAT, PARQUET, REPORT, TRAJECTORIES, seed_folder, write_bytes
from ..documents.spread import Spread
from ..errors import InputError
from ..pairing.controller import Controller
from ..study.declaration import Study
from ..study.evaluate import EvaluationStudy, SpreadStudy
from ..study.requests import Event, SeedDone
from ..views.units import number
from .output import tell_written
from .study import StudyCommand, study_of
from .values import Parser

# Imports inside functions: pyarrow and SciPy are loaded by those who need them.

EXAMPLES = """examples:
  flexible-manipulator evaluate                              # the paper's PID
  flexible-manipulator evaluate my_controller.fmu            # your controller
  flexible-manipulator evaluate my_controller.fmu --quick    # a first impression in seconds, not comparable
  flexible-manipulator evaluate --set "K_p[1]=60"            # the PID with another gain
  flexible-manipulator evaluate --only 'c07.*'               # one configuration
  flexible-manipulator evaluate --only '*.slippery.delay_2'  # one system and test
  flexible-manipulator evaluate my_controller.fmu --seeds 0-9  # mean and standard deviation over ten seeds
  flexible-manipulator evaluate --list                       # the names of all cases
  flexible-manipulator evaluate my_controller.fmu --dry-run  # how many cases there are, and how long they take
"""


NO_TRAJECTORIES = (
    "An evaluation without --no-report keeps trajectories, except of cases that hung, crashed or ended before the "
    "force."
)

IDLE_OPTIONS = ("only", "seeds", "force", "keep_going", "output_dir", "no_report", "figures", "parquet", "mat", "json",
                "form", "dry_run")  # fmt: skip
"""Options that have no effect where the cases are only listed."""


def _options(parser: Parser) -> None:
    parser.add_argument(
        "--quick",
        action="store_const",
        const="quick",
        dest="protocol",
        default=argparse.SUPPRESS,
        help="the same as --protocol quick",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the protocol's cases, and run nothing")
    add_files(parser)


def _check(given: argparse.Namespace) -> None:
    check_files(given)
    if given.list and any(getattr(given, name) for name in IDLE_OPTIONS):
        raise InputError("--list runs nothing: leave out the options of a run.", "contradiction", "--list")


def _study(given: argparse.Namespace) -> EvaluationStudy | SpreadStudy:
    one = study_of(EvaluationStudy, given, recordings=need_recordings(given))
    return SpreadStudy(given.seeds, one) if given.seeds else one


def _on_event(given: argparse.Namespace, folder: Path, event: Event) -> None:
    """Write the files that were asked for, of one of several seeds."""
    if isinstance(event, SeedDone):
        print(f"seed {event.seed}: V = {number(event.evaluation.cost)}", file=sys.stderr)
        seed_path = folder / seed_folder(event.seed)
        written = list(_files(event.evaluation, seed_path, given))
        if not given.no_report:
            event.evaluation.report(seed_path / REPORT)
        tell_written(seed_path, written)


def _files(document: Evaluation | Spread, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    if isinstance(document, Spread):
        return ()
    recorded = [TRAJECTORIES] if document.recordings else []
    return [CASES, *recorded, *write_files(document, folder, given)]


def add_files(parser: argparse.ArgumentParser) -> None:
    """Options for files beside ``results.json`` and ``cases.csv``."""
    group = parser.add_argument_group("files of an evaluation")
    group.add_argument("--figures", action="store_true", help="write the paper's figures as PDF, SVG and PNG")
    group.add_argument("--parquet", action="store_true", help="write cases.parquet (needs pyarrow)")
    group.add_argument("--mat", action="store_true", help="write trajectories.mat, the recorded cases for MATLAB")


def check_files(given: argparse.Namespace) -> None:
    """Raise :class:`InputError` for a file that cannot be written, before anything is simulated."""
    if given.parquet and find_spec("pyarrow") is None:
        raise InputError("Parquet needs the package pyarrow: pip install pyarrow", "no-pyarrow")


def need_recordings(given: argparse.Namespace) -> bool:
    """Whether a file that was asked for shows trajectories."""
    return not given.no_report or given.figures or given.mat


def write_files(evaluation: Evaluation, folder: Path, given: argparse.Namespace) -> list[str]:
    """Write the files that were asked for, of an evaluation; returns the names of the files written.

    A file for which there are no data is left out, with a note.
    """
    written: list[str] = []
    left_out: list[str] = []
    if given.parquet:
        from ..documents.results import parquet_bytes

        write_bytes(folder / PARQUET, parquet_bytes(evaluation.results))
        written.append(PARQUET)
    if given.mat:
        if evaluation.recordings:
            from ..documents.results import mat_bytes

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


class EvaluateCommand(StudyCommand):
    """The command ``evaluate``; it can also list the cases."""

    def run(
        self, bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path, study: Study[Any]
    ) -> int:
        """See :meth:`.StudyCommand.run`."""
        if given.list:
            print("\n".join(case.id for case in bench.cases))
            return 0
        return super().run(bench, controller, given, folder, study)


main = EvaluateCommand(
    EvaluationStudy,
    "Evaluate a controller FMU on the flexible-manipulator benchmark.",
    EXAMPLES,
    options=_options,
    study=_study,
    check=_check,
    several_seeds=True,
    on_event=_on_event,
    files=_files,
).main
