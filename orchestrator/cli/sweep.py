"""Try a grid of parameter values of a controller FMU: V and stability of every combination."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from pathlib import Path

from ..api.benchmark import Benchmark
from ..documents.files import streamed, write_bytes, write_text
from ..documents.sweep import CSV, SVG, Sweep
from ..pairing.controller import Controller
from ..study.requests import Event, Study, TrialDone
from ..study.sweep import sweep
from . import options
from .study import StudyCommand
from .values import Parser, grid_values

EXAMPLES = """examples:
  python -m orchestrator.sweep my_controller.fmu --vary K_p[1]=20:80:5
  python -m orchestrator.sweep my_controller.fmu --vary K_p[1]=20:80:5:log --vary z_p[1]=0.8,0.9,0.95

The same command continues an interrupted sweep.
"""


def _options(parser: Parser) -> None:
    parser.add_argument(
        "--vary",
        action="append",
        required=True,
        type=grid_values,
        metavar="NAME=LOW:HIGH:COUNT[:log]",
        help="a parameter and its values, evenly spaced or as a list such as 0.8,0.9,0.95, in the unit the FMU has for "
        "it; may be given again: every combination is tried",
    )


def _study(bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> Study[Sweep]:
    return sweep(bench, controller, options.varied(given.vary))


def _tell() -> Callable[[Event], str]:
    def say(event: Event) -> str:
        assert isinstance(event, TrialDone)
        return f"{event.done:5d} of {event.total}"

    return say


def write_files(found: Sweep, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    """Write the files beside the page of a sweep; returns their names."""
    write_text(folder / CSV, found.csv())
    if len(found.varied) > 2:
        return [CSV]
    from ..documents.style import FORMATS  # Matplotlib takes as long to load as the rest of the command

    figure = found.plot()
    write_bytes(folder / SVG, streamed(lambda file: figure.savefig(file, format="svg", **FORMATS["svg"])))
    return [CSV, SVG]


main = StudyCommand(
    name="sweep",
    help="Try a grid of parameter values of a controller FMU.",
    examples=EXAMPLES,
    study=_study,
    options=_options,
    suffix=lambda given: "-sweep",
    protocol="tuning",
    tell=_tell,
    files=write_files,
).main
