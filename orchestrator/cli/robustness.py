"""Search for the worst case of a controller within the tolerances, for its stability margins and robustness radius."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Sequence
from pathlib import Path

from ..api.benchmark import Benchmark
from ..documents.files import TRAJECTORIES
from ..documents.robustness import Robustness
from ..pairing.controller import Controller
from ..search.findings import BUDGET
from ..study.requests import Event, StageDone, Study
from ..study.worst_case import answer_of, worst_case
from ..views.units import number
from .study import StudyCommand
from .values import MOST, Parser, natural
from .values import number as value

EXAMPLES = """examples:
  python -m orchestrator.robustness my_controller.fmu                   some minutes
  python -m orchestrator.robustness my_controller.fmu --budget 30000    ten times as long
  python -m orchestrator.robustness my_controller.fmu --restarts 3      three independent starts, and their spread
  python -m orchestrator.robustness my_controller.fmu --only B6 --no-list --budget 300

V found and the largest values are lower bounds: a longer search may find larger ones. Each failure comes with a command
that reproduces it. If the search finds no failure, the controller may still have one. The same command continues an
interrupted search.
"""


def _options(parser: Parser) -> None:
    parser.add_argument(
        "--budget",
        type=natural(1),
        default=BUDGET,
        metavar="N",
        help=f"simulated time, in whole cases (default: {BUDGET})",
    )
    parser.add_argument(
        "--minutes",
        type=value(most=MOST, positive=True),
        default=math.inf,
        metavar="M",
        help="time after which nothing new is searched (default: none)",
    )
    parser.add_argument(
        "--only",
        action="append",
        default=[],
        metavar="NAME",
        help="what to search for: B5, B6, B7, or a test such as delay_2; may be given again (default: all)",
    )
    parser.add_argument(
        "--restarts",
        type=natural(1),
        default=1,
        metavar="N",
        help="independent starts of the search for V, which share its budget (default: 1)",
    )
    parser.add_argument("--no-list", action="store_true", help="begin with the nominal system, not with the list")


def _study(bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> Study[Robustness]:
    recorded = not given.no_report
    return answer_of(
        worst_case(
            bench,
            controller,
            given.budget,
            given.minutes,
            given.protocol,
            given.only,
            not given.no_list,
            given.restarts,
            recorded,
        )
    )


def _tell() -> Callable[[Event], str]:
    def say(event: Event) -> str:
        assert isinstance(event, StageDone)
        known = [f"{name} {number(value, 1e3)} mm" for name, value in event.worst.items() if name in ("B5", "B7")]
        settling = [f"{name} {number(value)} s" for name, value in event.worst.items() if name == "B6"]
        words = "  ".join([f"V {number(event.cost)}", *settling, *known])
        return f"{event.spent:6.0f} whole cases  {event.stage:24}{words}"

    return say


def _files(found: Robustness, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    return [] if given.no_report else [TRAJECTORIES]


main = StudyCommand(
    name="robustness",
    help="Search for the worst case of a controller.",
    examples=EXAMPLES,
    study=_study,
    options=_options,
    suffix=lambda given: "-robustness",
    protocol="strict",
    tell=_tell,
    files=_files,
).main
