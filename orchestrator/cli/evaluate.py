"""Evaluate a controller FMU: run a protocol over all cores, print the scorecard, write the results."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..api.benchmark import Benchmark
from ..documents.evaluation import Evaluation
from ..documents.files import CASES, REPORT, TRAJECTORIES, seed_folder
from ..documents.spread import Spread
from ..errors import InputError
from ..pairing.controller import Controller
from ..study.declaration import Study
from ..study.evaluate import EvaluationStudy, SpreadStudy
from ..study.requests import Event, SeedDone
from ..views.units import number
from . import evaluation_files
from .output import tell_written
from .study import StudyCommand, study_of
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.evaluate                              the paper's PID
  python -m orchestrator.evaluate my_controller.fmu            your controller
  python -m orchestrator.evaluate my_controller.fmu --quick    a first impression in seconds, not comparable
  python -m orchestrator.evaluate --set K_p[1]=60              the PID with another gain
  python -m orchestrator.evaluate --only 'c07.*'               one configuration
  python -m orchestrator.evaluate --only '*.slippery.delay_2'  one system and test
  python -m orchestrator.evaluate my_controller.fmu --seeds 0-9   mean and standard deviation over ten seeds
  python -m orchestrator.evaluate --list                       the names of all cases
  python -m orchestrator.evaluate my_controller.fmu --dry-run  how many cases there are, and how long they take
"""


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
    evaluation_files.add_options(parser)


def _check(given: argparse.Namespace) -> None:
    evaluation_files.check_options(given)
    if given.list and any(getattr(given, name) for name in IDLE_OPTIONS):
        raise InputError("--list runs nothing: leave out the options of a run.", "contradiction", "--list")


def _study(given: argparse.Namespace) -> EvaluationStudy | SpreadStudy:
    one = study_of(EvaluationStudy, given, recordings=evaluation_files.need_recordings(given))
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
    return [CASES, *recorded, *evaluation_files.write_outputs(document, folder, given)]


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
