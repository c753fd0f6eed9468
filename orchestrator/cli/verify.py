"""Verify a controller: the result one can trust, with a certificate that repeats it."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ..api.benchmark import Benchmark
from ..benchmark.certificate import Score
from ..cache import VARIABLE
from ..codec import to_json
from ..documents.certificates import Verification, differences
from ..documents.files import prepare_folder
from ..documents.reasons import verification_reasons
from ..documents.wording import SHOWN, VERDICTS, number
from ..errors import InputError
from ..pairing.reference import IN_C, USUAL
from ..text import printable
from . import options
from .evaluate import folder_name
from .guard import EXIT_CODES, EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK
from .judged import verification_code
from .outputs import free
from .progress import progress
from .tables import safe, show_endings, show_reasons, table, terminal
from .values import Parser

FRESH, ALL, PROTOCOL = "fresh", "all", "verification"

EXAMPLES = """examples:
  python -m orchestrator.verify my_controller.fmu
  python -m orchestrator.verify my_controller.fmu --beside all
  python -m orchestrator.verify my_controller.fmu --draws 2027-01-01        a date, or a beacon, announced before
  python -m orchestrator.verify --repeat verification.json my_controller.fmu

With --repeat, exit code 1 says that the results differ, 3 that cases were skipped or lost, so that this is not judged.
"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    if given.controller is not None and not given.controller.is_file():
        raise InputError(f"{given.controller} does not exist.", "no-file", given.controller)
    with _fresh_cache():
        bench = options.benchmark(given)
        return _repeat(bench, given) if given.repeat else _verify(bench, given)


def _verify(bench: Benchmark, given: argparse.Namespace) -> int:
    controller = options.controller(given)
    # A certificate with fresh draws cannot be made again: none is overwritten.
    folder = given.output_dir or free(Path("runs") / folder_name(bench, controller, ()))
    prepare_folder(folder)
    options.announce(bench, controller)
    draws = None if given.draws == FRESH else given.draws
    with progress() as on_result:
        found = bench.verify(
            controller,
            draws=draws,
            strict=given.strict,
            beside=tuple(IN_C) if ALL in given.beside else given.beside,
            protocol=given.protocol,
            on_result=on_result,
        )
    found.save(folder)
    _print(found, given)
    print(f"written to {folder}: {found.FILE}", file=sys.stderr)
    return verification_code(found)


def _repeat(bench: Benchmark, given: argparse.Namespace) -> int:
    fixed = (given.draws != FRESH, not given.strict, given.beside is not USUAL, given.protocol != PROTOCOL)
    if any(fixed) or given.controller_parameters or given.parameter_files or given.connections or given.mapping_files:
        message = "The certificate says with what it is repeated: give it and the controller alone."
        raise InputError(message, "contradiction", given.repeat)
    certificate = Verification.load(given.repeat)
    with progress() as on_result:
        found = bench.repeat(certificate, given.controller, on_result=on_result)
    _print(found, given)
    results, rest = differences(certificate, found)
    for title, lines in (("made with other", rest), ("DIFFERENT", results)):
        for line in lines:
            print(printable(f"{title}: {line}"), file=sys.stderr)
    if results and verification_code(found) == EXIT_NOT_JUDGED:
        print("not judged whether it is equal to the certificate: cases were skipped or lost", file=sys.stderr)
        return EXIT_NOT_JUDGED
    print("equal to the certificate" if not results else "not equal to the certificate", file=sys.stderr)
    return EXIT_INCOMPLETE if results else EXIT_OK


@contextmanager
def _fresh_cache() -> Iterator[None]:
    """Within, nothing is taken from the user's cache, into which other controllers may have written."""
    before = os.environ.get(VARIABLE)
    with tempfile.TemporaryDirectory(prefix="flexible-manipulator-", ignore_cleanup_errors=True) as folder:
        os.environ[VARIABLE] = folder
        try:
            yield
        finally:
            os.environ.pop(VARIABLE)
            os.environ.update({} if before is None else {VARIABLE: before})


def _print(found: Verification, given: argparse.Namespace) -> None:
    if given.json:
        print(to_json(found))
    else:
        show(found, terminal())


def show(found: Verification, console: Console) -> None:
    """Print the figures over the draws, and those on the list of worst cases, beside those of the references."""
    where = "in a sandbox" if found.sandbox else "WITHOUT A SANDBOX"
    console.print(
        f"[bold]{safe(found.benchmark)}[/bold]  verification of [bold]{safe(found.controller.file)}[/bold], "
        f"protocol {safe(found.protocol)}, {where}\n"
        f"{len(found.draws)} draws from {found.source} entropy {safe(found.entropy)}\n"
        f"controller {found.controller.sha256}\n"
    )
    console.print(_table("Mean ± standard deviation over the draws", found, found.references))
    if found.strict is not None:
        known = {name: each.strict for name, each in found.references.items() if each.strict is not None}
        console.print(_table("The worst poses of strict, moved by the first draw", found.strict, known))
    cases = (*found.cases, *(found.strict.cases if found.strict else ()))
    show_endings(((f"{case.id} --seed {case.seed}", case) for case in cases), found.FILE, console)
    show_reasons(verification_reasons(found), console)


def _table(title: str, found: Score | Verification, others: Mapping[str, Score]) -> Table:
    columns = {"controller": found, **others}
    grid = table(title)
    grid.add_column("", no_wrap=True)
    for name in columns:
        grid.add_column(name, justify="right", no_wrap=True)
    grid.add_column("target", justify="right", no_wrap=True)
    grid.add_column("worst case", overflow="fold")
    for name, entry in found.criteria.items():
        factor, unit = SHOWN[entry.unit]
        own = (_figure(score.criteria[name].mean, score.criteria[name].sd, factor) for score in columns.values())
        worst = entry.worst_case
        where = f"{worst.id} --seed {worst.seed}" if worst else "-"
        grid.add_row(f"{name} \\[{unit}]", *own, number(entry.target, factor), safe(where))
    own = (f"[bold]{_figure(score.cost.mean, score.cost.sd)}[/bold]" for score in columns.values())
    grid.add_row("V", *own, "100", "")
    for name in found.requirements:
        worst = found.requirements[name].worst_case
        where = f"{worst.id} --seed {worst.seed}" if worst else "-"
        grid.add_row(name, *(_verdict(score, name) for score in columns.values()), "", safe(where))
    return grid


def _figure(mean: float | None, sd: float | None, factor: float = 1.0) -> str:
    return number(mean, factor) + ("" if sd is None else f" ± {number(sd, factor)}")


def _verdict(score: Score | Verification, name: str) -> str:
    found = score.requirements[name]
    return VERDICTS[found.passed] + (f" in {found.failed_draws}" if found.failed_draws else "")


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        "verify", "Verify a controller: draws nobody knew, a judge it cannot reach.", EXAMPLES + "\n" + EXIT_CODES
    )
    options.add_controller(parser)
    parser.add_argument(
        "--draws",
        default=FRESH,
        metavar="TEXT",
        help="what the draws follow from: a date or a beacon published after the controller (default: fresh entropy)",
    )
    parser.add_argument(
        "--no-strict",
        dest="strict",
        action="store_false",
        help="leave out the worst poses of the protocol strict, which are 108 of 318 simulations per controller",
    )
    parser.add_argument(
        "--beside",
        nargs="+",
        choices=(*IN_C, ALL),
        default=USUAL,
        metavar="NAME",
        help=f"references, given behind the controller, out of {', '.join(IN_C)}, or {ALL} "
        f"(default: {' '.join(USUAL)}, which take the least time)",
    )
    parser.add_argument(
        "--protocol",
        default=PROTOCOL,
        metavar="NAME",
        help="what is run once per draw (default: verification)",
    )
    parser.add_argument(
        "--repeat", type=Path, metavar="FILE", help="do the verification of a certificate again, and compare"
    )
    options.add_jobs(parser)
    parser.add_argument(
        "--output-dir", type=Path, metavar="FOLDER", help="where to write (default: runs/CONTROLLER-verification)"
    )
    parser.add_argument("--json", action="store_true", help="print verification.json instead of tables")
    return parser
