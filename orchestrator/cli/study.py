"""The commands of all studies: their options, the run or its plan, its progress, files, and the exit code."""

from __future__ import annotations

import argparse
import hashlib
import math
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, nullcontext
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, TypeVar

from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn, TimeRemainingColumn

from ..api.benchmark import Benchmark
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from ..benchmark.scorecard import cost_so_far
from ..codec import to_json
from ..documents.document import Comparable, Document
from ..documents.evaluation import Evaluation
from ..documents.files import REPORT
from ..pairing.controller import Controller
from ..study.declaration import Option, Study, default
from ..study.dry_run import DryRun
from ..study.requests import Event, OnResult
from ..text import file_name, shortened
from ..views.terminal import terminal
from . import options, output
from .guard import EXIT_CODES, EXIT_OK
from .values import MAX_LIMIT, Parser, grid_values, natural, number, seeds, time, variation

ESTIMATE_EVERY = 8
"""Cases between two estimates of the cost; an estimate takes some milliseconds."""


@contextmanager
def progress(protocol: Protocol | None = None) -> Iterator[OnResult]:
    """A live progress bar; yields a function to call with each result. With a protocol, it shows V so far."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("cases  V so far {task.fields[cost]}" if protocol is not None else "cases"),
        TimeElapsedColumn(),
        TextColumn("left"),
        TimeRemainingColumn(),
    )
    results: list[CaseResult] = []
    bar = Progress(*columns, console=terminal(stderr=True))
    task = bar.add_task("evaluating", total=None, cost="-")
    with ExitStack() as stack:

        def update(result: CaseResult, done: int, total: int) -> None:
            if not bar.live.is_started:  # what is wrong with the input is said before any bar is drawn
                stack.enter_context(bar)
            if done == 1:  # of the first seed, or of the next
                results.clear()
            results.append(result)
            bar.update(task, completed=done, total=total)
            if protocol is not None and (done % ESTIMATE_EVERY == 0 or done == total):
                cost = cost_so_far(protocol, results)
                bar.update(task, cost="-" if cost is None else f"{cost:.1f}")

        yield update


Shown = Document | Evaluation
Kind = TypeVar("Kind", bound=Study[Any])

MAX_NAME = 60
"""Characters of parameters in a folder's name; more become a hash."""


READERS: dict[str, Callable[[str], Any]] = {
    "Mapping[str, Range | tuple[float, float] | tuple[float, float, str]]": variation,
    "Mapping[str, Sequence[float]]": grid_values,
    "Iterable[int]": seeds,
    "Sequence[Fraction | float | str]": lambda text: [time(part) for part in text.split(",")],
}
"""What reads a word of the command line, by the annotation of the field that it is for."""


def add_fields(parser: Parser, study: type[Study[Any]]) -> None:
    """Add an option for each field of ``study`` that the command asks for."""
    groups: dict[str, argparse._ActionsContainer] = {}
    for attribute in fields(study):
        told = attribute.metadata["option"]
        if not told.asked:
            continue
        place: argparse._ActionsContainer = parser.rare if told.rare else parser
        if told.exclude and told.exclude not in groups:
            groups[told.exclude] = place.add_mutually_exclusive_group()
        place = groups.get(told.exclude, place)
        word = (told.word or attribute.name).replace("_", "-")
        kind, value = str(attribute.type), default(attribute)
        if kind == "bool":
            flag, action = (f"--no-{word}", "store_false") if value else (f"--{word}", "store_true")
            place.add_argument(flag, dest=attribute.name, action=action, help=told.off or told.help)
            continue
        several = kind.startswith(("Mapping", "Sequence[str]"))
        bare = several or value in (None, math.inf) or told.required
        place.add_argument(
            f"--{word}",
            dest=attribute.name,
            action="append" if several else "store",
            default=[] if several else value,
            type=_reader(kind, told),
            choices=told.choices or None,
            required=told.required,
            metavar=told.metavar or None,
            help=told.help + ("; may be given again" if several else "") + ("" if bare else f" (default: {value})"),
        )


def _reader(kind: str, told: Option) -> Callable[[str], Any]:
    if kind in READERS:
        return READERS[kind]
    if kind.startswith("int"):
        return natural(int(told.least or 0))
    if kind == "float":
        return number(most=MAX_LIMIT, above=told.above, below=told.below)
    return str


def study_of(kind: type[Kind], given: argparse.Namespace, **rest: Any) -> Kind:
    """The study that the options of the command describe; ``rest`` are fields that it does not ask for."""
    values = dict(rest)
    for attribute in fields(kind):
        if attribute.metadata["option"].asked:
            value = getattr(given, attribute.name)
            values[attribute.name] = options.varied(value) if str(attribute.type).startswith("Mapping") else value
    if kind.protocol_option:
        values[kind.protocol_option] = given.protocol
    if "recordings" in {attribute.name for attribute in fields(kind)}:
        values.setdefault("recordings", not given.no_report)
    return kind(**values)


@dataclass(frozen=True)
class StudyCommand:
    """A command that runs a study of a ``kind`` and shows its document.

    ``options`` adds what the study itself does not have; ``study`` makes the study of what was given, ``check`` looks
    for what contradicts itself before. ``tell`` puts events into words; without it there is a progress bar. ``files``
    writes what belongs to the document beside it and the report, and gives the names. ``program`` is how it is started,
    if not as ``flexible-manipulator``.
    """

    kind: type[Study[Any]]
    help: str
    examples: str = ""
    options: Callable[[Parser], None] = lambda parser: None
    study: Callable[[argparse.Namespace], Study[Any]] | None = None
    check: Callable[[argparse.Namespace], None] = lambda given: None
    several_seeds: bool = False
    tell: Callable[[], Callable[[Event], str]] | None = None
    on_event: Callable[[argparse.Namespace, Path, Event], None] = lambda given, folder, event: None
    files: Callable[[Any, Path, argparse.Namespace], Sequence[str]] = lambda document, folder, given: ()
    report: bool = True
    program: str = ""

    def parser(self) -> Parser:
        """The parser of its options."""
        kind = self.kind
        protocols = [default(attribute) for attribute in fields(kind) if attribute.name == kind.protocol_option]
        parser = Parser(kind.command, self.help, f"{self.examples}\n{EXIT_CODES}", self.program)
        add_fields(parser, kind)
        self.options(parser)
        options.add_controller(parser)
        options.add_protocol(parser, self.several_seeds, *protocols)
        options.add_jobs(parser)
        if not kind.on_this_machine:
            options.add_cluster(parser)
        place = f"runs/CONTROLLER-PROTOCOL{kind.suffix}"
        parser.add_argument("--output-dir", type=Path, metavar="FOLDER", help=f"where to write (default: {place})")
        if self.report:
            parser.rare.add_argument("--no-report", action="store_true", help="write no report.html")
        output.add_options(parser, "the JSON document")
        output.add_dry_run(parser, "the number of different cases, those in the store, and the estimated time")
        return parser

    def main(self, arguments: Sequence[str] | None = None) -> int:
        """Run the command line and return its exit code."""
        words = list(sys.argv[1:] if arguments is None else arguments)
        given = self.parser().parse_args(words)
        options.refuse_idle(given)
        self.check(given)
        # Documents say the command that repeats them: quoted, so that it can be pasted.
        command = f"{self.parser().prog} {shlex.join(words)}".strip()
        bench, controller = replace(options.benchmark(given), command=command), options.controller(given)
        study = study_of(self.kind, given) if self.study is None else self.study(given)
        folder = given.output_dir or Path("runs") / f"{folder_name(bench, controller, given)}{study.suffix}"
        return self.run(bench, controller, given, folder, study)

    def run(
        self, bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path, study: Study[Any]
    ) -> int:
        """Run the study, print its document, and write its files into ``folder``."""
        options.announce(bench, controller)
        if given.dry_run:
            return show_plan(bench.plan(study, controller, folder=folder), given.json)
        say = None if self.tell is None else self.tell()

        def on_event(event: Event) -> None:
            if say is not None:
                print(say(event), file=sys.stderr)
            self.on_event(given, folder, event)

        # A verification draws other cases than the protocol's list: V so far would be of none of them.
        rules = None if study.on_this_machine else bench.rules
        with progress(rules) if say is None else nullcontext() as on_result:
            document = bench.run(study, controller, folder=folder, on_result=on_result, on_event=on_event)
        written = [*self.files(document, folder, given), *self._report(document, folder, given)]
        name = document.results.FILE if isinstance(document, Evaluation) else document.FILE
        output.tell_written(folder, [name, *written])
        output.put(document, given, document.results if isinstance(document, Evaluation) else None)
        return output.EXITS[document.completeness]

    def _report(self, document: Comparable, folder: Path, given: argparse.Namespace) -> list[str]:
        if not self.report or given.no_report:
            return []
        document.report(folder / REPORT, folder)
        return [REPORT]


def show_plan(plan: DryRun, as_json: bool) -> int:
    """Print what a study would do."""
    if as_json:
        print(to_json(plan))
    else:
        left = plan.cases - plan.stored
        print(f"{plan.cases} cases, {plan.stored} of them in the store")
        print(f"{left} to simulate, about {plan.seconds:.0f} s on {plan.workers} processes")
        print(f"(one takes {plan.seconds_per_case:.3g} s of processor time)")
    return EXIT_OK


def folder_name(bench: Benchmark, controller: Controller, given: argparse.Namespace) -> str:
    """A name for the folder of the results: controller, protocol, and every setting that is not the default."""
    name = f"{controller.name}-{bench.rules.name}" + (f"-seed{bench.seed}" if bench.seed else "")
    # Else the corners would take the place of a sample of the box.
    distribution = getattr(given, "distribution", "box")
    name += "" if distribution == "box" else f"-{distribution}"
    plant = bench.manipulator.model if bench.manipulator.build == "file" else ""
    only = getattr(given, "only", ())
    # What has no short name still keeps results of different settings apart, by a hash.
    unusual = [sorted(controller.setup.mapping.items()), sorted(bench.plant_parameters.items()), only, plant]
    values = [f"{key}={shortened(value)}" for key, value in sorted(controller.setup.parameters.items())]
    if controller.sample_time is not None:
        values.append(f"T_s={float(controller.sample_time):g}")
    if controller.library is not None:
        values.append(f"library={controller.library}")
    readable = "-".join(["", *values])
    # File systems take 255 bytes, and a folder of fifty parameters is not read anyway.
    if len(readable) > MAX_NAME:
        unusual.append(readable)
        readable = ""
    if any(unusual):
        readable += "-" + hashlib.sha256(repr(unusual).encode()).hexdigest()[:6]
    return file_name(name + readable)
