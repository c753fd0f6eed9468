"""Tune the parameters of a controller FMU: a search for those that make V small while A1 to A3 hold."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from ..api.benchmark import Benchmark
from ..benchmark.protocol import names
from ..documents.tuning import Tuning
from ..pairing.controller import Controller
from ..search.candidates import Trial
from ..search.proposals import SAMPLERS, STUDY
from ..study.requests import Event, Study, TrialDone
from ..study.tune import BEST, tune
from ..text import printable
from ..views.units import number
from . import options
from .study import StudyCommand
from .values import Parser, natural, variation

EXAMPLES = """examples:
  python -m orchestrator.tune my_controller.fmu --vary K_p[1]=20:80:log --vary z_p[1]=0.8:0.99
  python -m orchestrator.tune my_controller.fmu --vary K_p[1]=20:80:log --trials 500 --robust 2000

The same command continues an interrupted search, with the same result. Use best.toml with --parameters. If no candidate
holds A1 to A3 where it was judged, the exit code is 1, too.
"""


def _options(parser: Parser) -> None:
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        type=variation,
        metavar="NAME=LOW:HIGH[:log]",
        help="a parameter and its range, in the unit the FMU has for it; may be given again",
    )
    parser.add_argument("--trials", type=natural(1), default=200, metavar="N", help="candidates (default: 200)")
    parser.add_argument(
        "--objective",
        default="tuning",
        metavar="NAME",
        help=f"the short protocol that candidates are tried in, one of: {', '.join(names())}; or a protocol file "
        "(default: tuning)",
    )
    parser.add_argument(
        "--robust",
        type=natural(),
        default=0,
        metavar="N",
        help="search for the worst case of the best candidates, with a budget of N whole cases each, at "
        "least the 839 of the strict list, and count what is found (default: 0)",
    )
    parser.add_argument("--sampler", choices=SAMPLERS, default="cmaes", help="of Optuna (default: cmaes)")
    parser.add_argument("--search-seed", type=natural(), default=1, metavar="N", help="of the sampler (default: 1)")


def _study(bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> Study[Tuning]:
    record = None if given.dry_run else folder / STUDY
    rest = (given.trials, given.robust, given.sampler, given.search_seed, record)
    return tune(bench, controller, options.varied(given.vary), given.objective, "strict", *rest)


def _tell() -> Callable[[Event], str]:
    best: list[Trial] = []

    def say(event: Event) -> str:
        if not isinstance(event, TrialDone):
            return ""
        trial = event.trial
        failing = f", {', '.join(trial.fails)} fail{'s' * (len(trial.fails) == 1)}" if trial.fails else ""
        best[:] = sorted([*best, trial], key=lambda each: each.objective)[:1]
        came_to = trial.message or f"V = {number(trial.cost)}" + (" and worse" if trial.cut_short else failing)
        lead = f"best so far: objective {number(best[0].objective)}, V = {number(best[0].cost)}"
        return f"{event.done:5d} of {event.total}  {printable(came_to):24}  {lead}"

    return say


def _files(found: Tuning, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    return [] if found.best is None else [BEST]


main = StudyCommand(
    name="tune",
    help="Tune the parameters of a controller FMU.",
    examples=EXAMPLES,
    study=_study,
    options=_options,
    suffix=lambda given: "-tuning",
    tell=_tell,
    files=_files,
).main
