"""Verify a controller with draws that it cannot know, and write a certificate that others can repeat."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from ..api.benchmark import Benchmark
from ..benchmark.draws import from_beacon
from ..bounded import read
from ..documents.files import prepare_folder, write_bytes
from ..documents.verification import PROTOCOL, USUAL, Verification, differences
from ..errors import InputError
from ..execution.interpreter import is_clean, run_clean
from ..pairing.controller import IN_C, Controller
from ..study.declaration import Study
from ..study.requests import CaseChecked, Event
from ..study.verify import VerificationStudy
from ..text import printable
from . import output
from .guard import EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_NOT_STANDARD, EXIT_OK
from .output import free
from .study import StudyCommand, progress, study_of
from .values import Parser

FRESH, ALL = "fresh", "all"

MAX_ROUND_BYTES = 4096
"""Bytes that the JSON of a round of drand may have."""

EXAMPLES = """examples:
  flexible-manipulator verify my_controller.fmu
  flexible-manipulator verify my_controller.fmu --beside all
  flexible-manipulator verify my_controller.fmu --draws round.json --published 2027-01-31T12:00:00Z
  flexible-manipulator verify --repeat verification.json my_controller.fmu

exit codes of --repeat: 0 the results equal those of the certificate, to the last bit, and both were made under the
standard conditions; 4 the results are equal, but the conditions are not the standard ones, and the message names them;
1 the results differ; 3 not judged, since cases were skipped or lost.
"""


def _options(parser: Parser) -> None:
    parser.add_argument(
        "--draws",
        default=FRESH,
        metavar="ROUND",
        help="what the draws follow from: a round of the public beacon drand, as a file with its JSON or as "
        "drand:CHAIN:ROUND:SIGNATURE (default: fresh entropy of this machine)",
    )
    parser.add_argument(
        "--published",
        metavar="TIME",
        help="when the controller or its SHA-256 was published, such as 2027-01-31T12:00:00Z: the round must be later",
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
        "--repeat", type=Path, metavar="FILE", help="repeat the verification of a certificate, and compare"
    )


def _study(given: argparse.Namespace) -> Study[Verification]:
    draws = None if given.draws == FRESH else from_beacon(_round(given.draws), given.published or "")
    beside = tuple(IN_C) if ALL in given.beside else tuple(given.beside)
    return study_of(VerificationStudy, given, draws=draws, beside=beside)


def _check(given: argparse.Namespace) -> None:
    # Before the clean interpreter starts, which costs seconds.
    if given.controller is not None and not given.controller.is_file():
        raise InputError(f"{given.controller} does not exist.", "no-file", given.controller)
    # A seed that could be chosen would be tried until the draws are kind.
    if given.seed is not None:
        raise InputError("A verification draws its own seeds: leave out --seed.", "contradiction", "--seed")
    # Without the time, a round from before the publication would be taken: the controller may have been made for it.
    if (given.draws != FRESH) != (given.published is not None) and not given.repeat:
        message = "A round of a beacon needs the time when the controller was published: give --draws and --published."
        raise InputError(message, "contradiction", "--published")
    drawn = given.draws != FRESH or given.published is not None
    fixed = (drawn, not given.strict, given.beside is not USUAL, given.protocol != PROTOCOL)
    named = given.controller_parameters or given.parameter_files or given.connections or given.mapping_files
    if given.repeat and (any(fixed) or named or given.output_dir or given.dry_run):
        message = "The certificate holds all other settings: give only the certificate and the controller."
        raise InputError(message, "contradiction", given.repeat)


def _round(draws: str) -> str:
    """The text of a round: that of a file if there is one."""
    file = Path(draws)
    try:
        given = file.is_file()
    except OSError as problem:
        raise InputError(f"{draws} cannot be read: {problem.strerror}.", "no-beacon", draws) from None
    return read(file, MAX_ROUND_BYTES, "no-beacon").decode(errors="replace") if given else draws


class VerifyCommand(StudyCommand):
    """The command ``verify``; it can also repeat a certificate."""

    def run(
        self, bench: Benchmark, controller: Controller, given: argparse.Namespace, folder: Path, study: Study[Any]
    ) -> int:
        """See :meth:`.StudyCommand.run`."""
        if given.repeat:
            return _repeat(bench, given)
        if not given.output_dir:
            # A certificate with fresh draws cannot be made again: none is overwritten.
            folder = free(folder if given.protocol == PROTOCOL else folder.with_name(f"{folder.name}-verification"))
        if not given.dry_run:
            prepare_folder(folder)
        return super().run(bench, controller, given, folder, study)


def _repeat(bench: Benchmark, given: argparse.Namespace) -> int:
    certificate = Verification.load(given.repeat)
    with progress() as on_result:
        repeated = bench.repeat(certificate, given.controller, on_result=on_result)
    output.put(repeated, given)
    results, rest = differences(certificate, repeated)
    for title, lines in (("made with other", rest), ("DIFFERENT", results)):
        for line in lines:
            print(printable(f"{title}: {line}"), file=sys.stderr)
    if results and not (certificate.finished and repeated.finished):
        print("not judged whether it is equal to the certificate: cases were skipped or lost", file=sys.stderr)
        return EXIT_NOT_JUDGED
    if results:
        print("not equal to the certificate", file=sys.stderr)
        return EXIT_INCOMPLETE
    deviations = (f"this repetition: {words}" for words in repeated.deviations if words not in certificate.deviations)
    unusual = (*certificate.deviations, *deviations)
    for line in unusual:
        print(printable(f"not standard: {line}"), file=sys.stderr)
    print(f"equal to the certificate{', but not under the standard conditions' if unusual else ''}", file=sys.stderr)
    # Equal numbers prove nothing if they were made under conditions that let the controller know its draws.
    return EXIT_NOT_STANDARD if unusual else EXIT_OK


def _files(certificate: Verification, folder: Path, given: argparse.Namespace) -> Sequence[str]:
    certificate.save(folder)
    return sorted(file.name for file in folder.glob("case-*.npz"))


def _on_event(given: argparse.Namespace, folder: Path, event: Event) -> None:
    """Keep what the second checker has read."""
    if isinstance(event, CaseChecked):
        write_bytes(folder / event.name, event.content)


COMMAND = VerifyCommand(
    VerificationStudy,
    "Verify a controller with draws that it cannot know, and write a certificate.",
    EXAMPLES,
    options=_options,
    study=_study,
    check=_check,
    files=_files,
    on_event=_on_event,
    report=False,
)


main = COMMAND.main
"""The command in this interpreter."""


def clean(arguments: Sequence[str] | None = None) -> int:
    """Run the command in a clean interpreter; in this one if it is clean, or if only help is asked for."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if is_clean() or not words or {"-h", "--help", "--dry-run"} & set(words):
        return main(words)
    COMMAND.check(COMMAND.parser().parse_args(words))  # what is wrong is said at once
    code = "from orchestrator.cli.guard import run; raise SystemExit(run('verify', sys.argv[1:]))"
    return run_clean(code, words)
