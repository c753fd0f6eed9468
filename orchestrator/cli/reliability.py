"""Sample independent draws of the uncertainty for a controller FMU: how likely a failure is at most."""

from __future__ import annotations

import argparse
from pathlib import Path

from ..api.benchmark import Benchmark
from ..benchmark.reliability import draws_needed
from ..documents.files import RELIABILITY
from ..documents.reliability import Reliability
from ..pairing.controller import Controller
from ..study.reliability import reliability
from ..study.requests import Study
from .study import StudyCommand
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.reliability my_controller.fmu
  python -m orchestrator.reliability my_controller.fmu --probability 0.001 --confidence 0.99
  python -m orchestrator.reliability my_controller.fmu --distribution corners
  python -m orchestrator.reliability my_controller.fmu --more 500

A sample without a failure bounds the probability of a failure: 459 draws by 0.01, 4603 draws by 0.001, at 99 %
confidence. The same command continues an interrupted sample; --more adds draws to a finished one.
"""


def _options(parser: Parser) -> None:
    parser.add_argument(
        "--probability",
        type=float,
        default=0.01,
        help="of failure, and of a draw beyond the bounds of the criteria; with --confidence it says how many draws "
        "there are (default: 0.01)",
    )
    parser.add_argument("--confidence", type=float, default=0.99, help="of the bounds (default: 0.99)")
    parser.add_argument(
        "--distribution",
        choices=("box", "corners"),
        default="box",
        help="of the uncertain parameters: uniform within Table 1, or each at one of its ends (default: box)",
    )
    size = parser.add_mutually_exclusive_group()
    size.add_argument("--draws", type=int, metavar="N", help="so many draws instead")
    size.add_argument("--more", type=int, metavar="N", help="so many draws more than the folder has")


def _study(bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> Study[Reliability]:
    draws = given.draws
    if given.more is not None:
        draws = Reliability.load(folder / RELIABILITY).draws + given.more
    elif draws is None:
        draws = draws_needed(given.probability, given.confidence)
    return reliability(bench, controller, draws, given.probability, given.confidence, given.distribution)


main = StudyCommand(
    name="reliability",
    help="Bound a controller's probability of failure by independent draws of the uncertainty.",
    examples=EXAMPLES,
    study=_study,
    options=_options,
    suffix=lambda given: "-reliability",
).main
