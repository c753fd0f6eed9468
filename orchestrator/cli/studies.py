"""The commands of the studies that need no options beside those of the study: how events are told, and which files are
written beside document and report."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from ..documents.files import TRAJECTORIES, write_bytes, write_text
from ..documents.robustness import Robustness
from ..documents.sweep import CSV, SVG, Sweep
from ..documents.tuning import Tuning
from ..study.reliability import ReliabilityStudy
from ..study.requests import Event, StageDone, TrialDone
from ..study.sweep import SweepStudy
from ..study.tune import BEST, TuningStudy
from ..study.worst_case import RobustnessStudy
from ..text import printable
from ..views.units import number
from .study import StudyCommand

ROBUSTNESS_EXAMPLES = """examples:
  flexible-manipulator robustness my_controller.fmu                   # some minutes
  flexible-manipulator robustness my_controller.fmu --budget 30000    # ten times as long
  flexible-manipulator robustness my_controller.fmu --restarts 3      # three independent starts, and their spread
  flexible-manipulator robustness my_controller.fmu --only B6 --no-list --budget 300

V found and the largest values are lower bounds: a longer search may find larger ones. Each failure comes with a command
that reproduces it. If the search finds no failure, the controller may still have one. The same command continues an
interrupted search.
"""

RELIABILITY_EXAMPLES = """examples:
  flexible-manipulator reliability my_controller.fmu
  flexible-manipulator reliability my_controller.fmu --probability 0.001 --confidence 0.99
  flexible-manipulator reliability my_controller.fmu --distribution corners
  flexible-manipulator reliability my_controller.fmu --distribution corners --only A2 --draws 12000
  flexible-manipulator reliability my_controller.fmu --more 500

A sample without a failure bounds the probability of a failure: 459 draws by 0.01, 4603 draws by 0.001, at 99 %
confidence. The same command continues an interrupted sample; --more adds draws to a finished one.
"""

TUNE_EXAMPLES = """examples:
  flexible-manipulator tune my_controller.fmu --vary "K_p[1]=20:80:log" --vary "z_p[1]=0.8:0.99"
  flexible-manipulator tune my_controller.fmu --vary "K_p[1]=20:80:log" --trials 500 --robust 2000

The same command continues an interrupted search, with the same result. Use best.toml with --parameters. If no candidate
holds A1 to A3 where it was judged, the exit code is 1, too.
"""

SWEEP_EXAMPLES = """examples:
  flexible-manipulator sweep my_controller.fmu --vary "K_p[1]=20:80:5"
  flexible-manipulator sweep my_controller.fmu --vary "K_p[1]=20:80:5:log" --vary "z_p[1]=0.8,0.9,0.95"

The same command continues an interrupted sweep.
"""


def _tell_stages() -> Callable[[Event], str]:
    def say(event: Event) -> str:
        assert isinstance(event, StageDone)
        errors = [f"{name} {number(value, 1e3)} mm" for name, value in event.worst.items() if name in ("B5", "B7")]
        settling = [f"{name} {number(value)} s" for name, value in event.worst.items() if name == "B6"]
        words = "  ".join([f"V {number(event.cost)}", *settling, *errors])
        return f"{event.spent:6.0f} whole cases  {event.stage:24}{words}"

    return say


def _tell_candidates() -> Callable[[Event], str]:
    def say(event: Event) -> str:
        if not isinstance(event, TrialDone):
            return ""
        trial, best = event.trial, event.best
        failing = f", {', '.join(trial.fails)} fail{'s' * (len(trial.fails) == 1)}" if trial.fails else ""
        came_to = trial.message or f"V = {number(trial.cost)}" + (" and worse" if trial.cut_short else failing)
        lead = "" if best is None else f"best so far: objective {number(best.objective)}, V = {number(best.cost)}"
        return f"{event.done:5d} of {event.total}  {printable(came_to):24}  {lead}".rstrip()

    return say


def _tell_combinations() -> Callable[[Event], str]:
    def say(event: Event) -> str:
        assert isinstance(event, TrialDone)
        return f"{event.done:5d} of {event.total}"

    return say


def _recordings(document: Robustness, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    return [] if given.no_report else [TRAJECTORIES]


def _best(document: Tuning, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    return [] if document.best is None else [BEST]


def sweep_files(sweep: Sweep, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    """Write the files beside the page of a sweep; returns their names."""
    write_text(folder / CSV, sweep.csv())
    if len(sweep.varied) > 2:
        return [CSV]
    from ..views.drawing import encoded  # Matplotlib takes as long to load as the rest of the command

    write_bytes(folder / SVG, encoded(sweep.plot(), "svg"))
    return [CSV, SVG]


robustness = StudyCommand(
    RobustnessStudy,
    "Search for the worst case of a controller.",
    ROBUSTNESS_EXAMPLES,
    tell=_tell_stages,
    files=_recordings,
).main

reliability = StudyCommand(
    ReliabilityStudy,
    "Bound a controller's probability of failure by independent draws of the uncertainty.",
    RELIABILITY_EXAMPLES,
).main

tune = StudyCommand(
    TuningStudy, "Tune the parameters of a controller FMU.", TUNE_EXAMPLES, tell=_tell_candidates, files=_best
).main

sweep = StudyCommand(
    SweepStudy,
    "Try a grid of parameter values of a controller FMU.",
    SWEEP_EXAMPLES,
    tell=_tell_combinations,
    files=sweep_files,
).main
