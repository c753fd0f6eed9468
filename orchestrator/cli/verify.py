"""Verify a controller: the result one can trust, with a certificate that repeats it."""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..api.benchmark import Benchmark
from ..cache import VARIABLE
from ..documents.files import prepare_folder
from ..documents.verification import Verification, differences
from ..errors import InputError
from ..pairing.controller import Controller
from ..pairing.reference import IN_C, USUAL
from ..study.engine import can_fence
from ..study.requests import Study
from ..study.verify import verify
from ..text import printable
from . import output
from .guard import EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK
from .output import free
from .progress import progress
from .study import StudyCommand
from .values import Parser

FRESH, ALL, PROTOCOL, DRAWS = "fresh", "all", "verification", 3

EXAMPLES = """examples:
  python -m orchestrator.verify my_controller.fmu
  python -m orchestrator.verify my_controller.fmu --beside all
  python -m orchestrator.verify my_controller.fmu --draws 2027-01-01        a date, or a beacon, announced before
  python -m orchestrator.verify --repeat verification.json my_controller.fmu

With --repeat, exit code 1 says that the results differ, 3 that cases were skipped or lost, so that this is not judged.
"""


def _options(parser: Parser) -> None:
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
        "--repeat", type=Path, metavar="FILE", help="do the verification of a certificate again, and compare"
    )


def _study(bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> Study[Verification]:
    if not given.dry_run:
        prepare_folder(folder)
    draws = None if given.draws == FRESH else given.draws
    beside = tuple(IN_C) if ALL in given.beside else tuple(given.beside)
    return verify(bench, controller, draws, DRAWS, given.strict, beside, bench.sandbox or can_fence())


def _check(given: argparse.Namespace) -> None:
    if given.controller is not None and not given.controller.is_file():
        raise InputError(f"{given.controller} does not exist.", "no-file", given.controller)
    if given.seed is not None:
        raise InputError("A verification draws its own seeds: leave out --seed.", "contradiction", "--seed")
    fixed = (given.draws != FRESH, not given.strict, given.beside is not USUAL, given.protocol != PROTOCOL)
    named = given.controller_parameters or given.parameter_files or given.connections or given.mapping_files
    if given.repeat and (any(fixed) or named or given.output_dir or given.dry_run):
        message = "The certificate says with what it is repeated: give it and the controller alone."
        raise InputError(message, "contradiction", given.repeat)


class VerifyCommand(StudyCommand):
    """The command, which can also repeat a certificate."""

    def run(self, bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path) -> int:
        """See :meth:`.StudyCommand.run`."""
        with _fresh_cache():
            if given.repeat:
                return _repeat(bench, given)
            # A certificate with fresh draws cannot be made again: none is overwritten.
            return super().run(bench, controller, given, folder if given.output_dir else free(folder))


def _repeat(bench: Benchmark, given: argparse.Namespace) -> int:
    certificate = Verification.load(given.repeat)
    with progress() as on_result:
        found = bench.repeat(certificate, given.controller, on_result=on_result)
    output.put(found, given)
    results, rest = differences(certificate, found)
    for title, lines in (("made with other", rest), ("DIFFERENT", results)):
        for line in lines:
            print(printable(f"{title}: {line}"), file=sys.stderr)
    if results and found.completeness == "not judged":
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


def _files(found: Verification, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    found.save(folder)
    return ()


main = VerifyCommand(
    name="verify",
    help="Verify a controller: draws nobody knew, a judge it cannot reach.",
    examples=EXAMPLES,
    study=_study,
    options=_options,
    check=_check,
    suffix=lambda given: "" if getattr(given, "protocol", PROTOCOL) == PROTOCOL else "-verification",
    protocol=PROTOCOL,
    here=True,
    files=_files,
    report=False,
).main
