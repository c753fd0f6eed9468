"""What the commands of all studies share: options, the run or its plan, files, and the exit code."""

from __future__ import annotations

import argparse
import hashlib
import shlex
import sys
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from ..api.benchmark import Benchmark
from ..codec import to_json
from ..documents.document import Comparable, Document
from ..documents.evaluation import Evaluation
from ..documents.files import REPORT
from ..pairing.controller import Controller
from ..study.dry_run import Plan
from ..study.requests import Event, Study
from ..text import file_name, shortened
from . import options, output
from .guard import EXIT_CODES, EXIT_OK
from .progress import progress
from .values import Parser

Found = Document | Evaluation

LONGEST_NAME = 60
"""Characters of parameters in a folder's name; more become a hash."""


@dataclass(frozen=True)
class StudyCommand:
    """A command that runs a study and shows its document.

    ``options`` adds the options that are its own; ``study`` makes the study of what was given, ``check`` looks for what
    contradicts itself before. Its results stand in a folder named after controller and protocol, with a ``suffix``.
    ``protocol`` is the default. ``tell`` puts events into words; without it there is a progress bar. ``files`` writes
    what belongs to the document beside it and the report, and gives the names. ``here`` runs on this machine alone, and
    neither takes simulations from the folder nor keeps any there. ``program`` is how it is started, if not by
    ``python -m``.
    """

    name: str
    help: str
    examples: str
    study: Callable[[Benchmark, Controller, argparse.Namespace, Path], Study[Any]]
    options: Callable[[Parser], None] = lambda parser: None
    check: Callable[[argparse.Namespace], None] = lambda given: None
    suffix: Callable[[argparse.Namespace], str] = lambda given: ""
    protocol: str = "paper"
    several_seeds: bool = False
    here: bool = False
    tell: Callable[[], Callable[[Event], str]] | None = None
    on_event: Callable[[argparse.Namespace, Path, Event], None] = lambda given, folder, event: None
    files: Callable[[Any, Path, argparse.Namespace], Sequence[str]] = lambda found, folder, given: ()
    report: bool = True
    program: str = ""

    def parser(self) -> Parser:
        """The parser of its options."""
        parser = Parser(self.name, self.help, f"{self.examples}\n{EXIT_CODES}", self.program)
        options.add_controller(parser)
        options.add_protocol(parser, self.several_seeds, self.protocol)
        self.options(parser)
        options.add_jobs(parser)
        if not self.here:
            options.add_cluster(parser)
        place = f"runs/CONTROLLER-PROTOCOL{self.suffix(argparse.Namespace(seeds=None))}"
        parser.add_argument("--output-dir", type=Path, metavar="FOLDER", help=f"where to write (default: {place})")
        if self.report:
            parser.add_argument("--no-report", action="store_true", help="write no report.html")
        output.add_options(parser, "the JSON document")
        output.add_dry_run(parser, "the number of different cases, those in the store, and the estimated time")
        return parser

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command line and return its exit code."""
        words = list(sys.argv[1:] if arguments is None else arguments)
        given = self.parser().parse_args(words)
        options.refuse_idle(given)
        self.check(given)
        command = f"{self.parser().prog} {shlex.join(words)}".strip()
        bench, controller = replace(options.benchmark(given), command=command), options.controller(given)
        folder = given.output_dir or Path("runs") / f"{folder_name(bench, controller, given)}{self.suffix(given)}"
        return self.run(bench, controller, given, folder)

    def run(self, bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> int:
        """Run the study, print its document, and write its files into ``folder``."""
        options.announce(bench, controller)
        study = self.study(bench, controller, given, folder)
        store = None if self.here else folder
        if given.dry_run:
            return show_plan(bench.engine(store, here=self.here).plan(study), given.json)
        say = None if self.tell is None else self.tell()

        def on_event(event: Event) -> None:
            if say is not None:
                print(say(event), file=sys.stderr)
            self.on_event(given, folder, event)

        with progress(None if self.here else bench.rules) if say is None else nullcontext() as on_result:
            found = bench.engine(store, on_result, on_event, here=self.here).run(study)
        written = [*self.files(found, folder, given), *self._report(found, folder, given)]
        name = found.results.FILE if isinstance(found, Evaluation) else found.FILE
        output.tell_written(folder, [name, *written])
        output.put(found, given, found.results if isinstance(found, Evaluation) else None)
        return output.EXITS[found.completeness]

    def _report(self, found: Comparable, folder: Path, given: argparse.Namespace) -> list[str]:
        if not self.report or given.no_report:
            return []
        found.report(folder / REPORT, folder)
        return [REPORT]


def show_plan(found: Plan, as_json: bool) -> int:
    """Print what a study would do."""
    if as_json:
        print(to_json(found))
    else:
        left = found.cases - found.stored
        print(f"{found.cases} cases, {found.stored} of them in the store")
        print(f"{left} to simulate, about {found.seconds:.0f} s on {found.workers} processes")
        print(f"(one takes {found.seconds_per_case:.3g} s of processor time)")
    return EXIT_OK


def folder_name(bench: Benchmark, controller: Controller, given: argparse.Namespace) -> str:
    """A name for the folder of the results: controller, protocol, and every setting that is not the default."""
    name = f"{controller.name}-{bench.rules.name}" + (f"-seed{bench.seed}" if bench.seed else "")
    plant = bench.manipulator.model if bench.manipulator.build == "file" else ""
    only = getattr(given, "only", ())
    unusual = [sorted(controller.setup.mapping.items()), sorted(bench.plant_parameters.items()), only, plant]
    values = [f"{key}={shortened(value)}" for key, value in sorted(controller.setup.parameters.items())]
    if controller.sample_time is not None:
        values.append(f"T_s={float(controller.sample_time):g}")
    readable = "-".join(["", *values])
    if len(readable) > LONGEST_NAME:
        unusual.append(readable)
        readable = ""
    if any(unusual):
        readable += "-" + hashlib.sha256(repr(unusual).encode()).hexdigest()[:6]
    return file_name(name + readable)
