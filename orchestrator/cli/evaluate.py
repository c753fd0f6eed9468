"""Evaluate a controller FMU: run a protocol over all cores, print the scorecard, write the results."""

from __future__ import annotations

import argparse
import hashlib
import sys
from collections.abc import Sequence
from pathlib import Path

from ..api.benchmark import Benchmark
from ..codec import to_json
from ..documents.evaluation import Evaluation
from ..documents.files import CASES, RESULTS, TRAJECTORIES, seed_folder
from ..documents.spread import Spread
from ..documents.wording import number
from ..pairing.controller import Controller
from ..study.evaluate import Options
from ..text import file_name
from . import options, outputs
from .guard import EXIT_CODES, EXIT_OK
from .judged import results_code
from .progress import progress
from .spread_tables import show_spread
from .tables import show_results, terminal
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.evaluate                              the paper's PID
  python -m orchestrator.evaluate my_controller.fmu            your controller
  python -m orchestrator.evaluate my_controller.fmu --quick    a look in seconds, not comparable
  python -m orchestrator.evaluate --set K_p[1]=60              the PID with another gain
  python -m orchestrator.evaluate --only 'c07.*'               one configuration
  python -m orchestrator.evaluate --only '*.slippery.delay_2'  one system and test
  python -m orchestrator.evaluate my_controller.fmu --seeds 0-9   mean and standard deviation over ten seeds
  python -m orchestrator.evaluate --list                       the names of all cases
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    outputs.check_options(given)
    bench = options.benchmark(given)
    if given.list:
        print("\n".join(case.id for case in bench.cases))
        return EXIT_OK
    controller = options.controller(given)
    options.announce(bench, controller)
    name = folder_name(bench, controller, given.only) + ("-seeds" if given.seeds else "")
    folder = given.output_dir or Path("runs") / name
    codes: list[int] = []

    def finish(evaluation: Evaluation, folder: Path) -> None:
        codes.append(results_code(evaluation.results))
        recorded = [TRAJECTORIES] if evaluation.recordings else []
        written = [RESULTS, CASES, *recorded, *outputs.write_outputs(evaluation, folder, given)]
        print(f"written to {folder}: {', '.join(written)}", file=sys.stderr)

    def finish_seed(seed: int, evaluation: Evaluation) -> None:
        print(f"seed {seed}: V = {number(evaluation.cost)}", file=sys.stderr)
        finish(evaluation, folder / seed_folder(seed))

    with progress(bench.rules) as on_result:
        shared: Options = {
            "only": given.only,
            "recordings": outputs.need_recordings(given),
            "keep_going": given.keep_going,
            "force": given.force,
        }
        found: Evaluation | Spread
        if given.seeds:
            found = bench.spread(
                controller, given.seeds, folder=folder, on_seed=finish_seed, on_result=on_result, **shared
            )
        else:
            found = bench.evaluate(controller, folder=folder, on_result=on_result, **shared)
            finish(found, folder)
    _print(found, given.json)  # at the end: the reader of standard output may go away
    return max(codes)


def _print(found: Evaluation | Spread, as_json: bool) -> None:
    if as_json:
        print(to_json(found.results if isinstance(found, Evaluation) else found))
    elif isinstance(found, Evaluation):
        show_results(found.results, terminal())
    else:
        show_spread(found, terminal())


def folder_name(bench: Benchmark, controller: Controller, only: Sequence[str]) -> str:
    """A name for the results: of controller and protocol, and of whatever is not as usual."""
    name = f"{controller.name}-{bench.rules.name}" + (f"-seed{bench.seed}" if bench.seed else "")
    plant = bench.manipulator.model if bench.manipulator.build == "file" else ""
    unusual = [sorted(controller.setup.mapping.items()), sorted(bench.plant_parameters.items()), only, plant]
    values = [f"{key}={value:g}" for key, value in sorted(controller.setup.parameters.items())]
    if controller.sample_time is not None:
        values.append(f"T_s={float(controller.sample_time):g}")
    readable = "-".join(["", *values])
    if len(readable) > LONGEST_NAME:
        unusual.append(readable)
        readable = ""
    if any(unusual):
        readable += "-" + hashlib.sha256(repr(unusual).encode()).hexdigest()[:6]
    return file_name(name + readable)


LONGEST_NAME = 60
"""Characters of parameters in a folder's name; more become a hash."""


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        "evaluate",
        "Evaluate a controller FMU on the flexible-manipulator benchmark.",
        EXAMPLES + "\n" + EXIT_CODES,
    )
    options.add_controller(parser)
    options.add_protocol(parser, several_seeds=True)
    parser.add_argument(
        "--quick",
        action="store_const",
        const="quick",
        dest="protocol",
        default=argparse.SUPPRESS,
        help="the same as --protocol quick",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="PATTERN",
        help="only cases whose name matches, with * and ?; may be given again",
    )
    parser.add_argument("--list", action="store_true", help="print the names of the protocol's cases, and run nothing")
    options.add_jobs(parser)
    parser.add_argument(
        "--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/CONTROLLER-PROTOCOL)"
    )
    parser.add_argument("--force", action="store_true", help="run again what an earlier run has finished")
    parser.add_argument(
        "--keep-going",
        action="store_true",
        help="do not give up after three failures of one kind, and run again what failed in an earlier run",
    )
    options.add_cluster(parser)
    parser.add_argument("--json", action="store_true", help="print results.json, or spread.json, instead of tables")
    outputs.add_options(parser)
    return parser
