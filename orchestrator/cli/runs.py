"""List past runs: what is in a folder, with its V and when it was made."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ..documents.document import Displayable
from ..errors import InputError
from ..text import printable
from ..views.table import Cell, Column, Summary, Table
from . import output
from .guard import EXIT_OK
from .loading import Loaded, kinds_in
from .values import Parser

EXAMPLES = """examples:
  python -m orchestrator.runs                     what is in the folder runs, the newest last
  python -m orchestrator.runs results/*           in other folders
  python -m orchestrator.runs --json              for a program

exit codes: 0 done, 2 no such folder"""


class Past(NamedTuple):
    """A run: its ``folder``, what was made, of which controller, in which protocol, its V, and when it was made."""

    folder: str
    kind: str
    controller: str
    protocol: str
    seed: int | None
    V: float | None
    holds: bool
    made: str


class Runs(Displayable):
    """Runs, the oldest first."""

    def __init__(self, runs: Sequence[Past]) -> None:
        self.runs = tuple(runs)

    def summary(self) -> Summary:
        """One line for each."""
        names = ("folder", "what", "controller", "protocol", "V", "A1-A3 met", "begun")
        rows: tuple[tuple[Cell, ...], ...] = tuple(
            (
                run.folder,
                run.kind,
                run.controller,
                run.protocol + (f", seed {run.seed}" if run.seed else ""),
                run.V,
                "yes" if run.holds else "no",
                run.made,
            )
            for run in self.runs
        )
        return Summary("Past runs", f"{len(self.runs)} found", (Table("Runs", tuple(map(Column, names)), rows),))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    folders = given.folders or [Path("runs")]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"There is no folder {folder}.", "no-folder", folder)
    past = Runs(sorted((run for folder in folders for run in _found(folder)), key=lambda run: (run.made, run.folder)))
    output.put(past, given, [run._asdict() for run in past.runs])
    return EXIT_OK


def _found(folder: Path) -> Iterator[Past]:
    """The runs in ``folder`` and in the folders directly below it; what cannot be read is told on standard error."""
    for place in (folder, *sorted(entry for entry in folder.iterdir() if entry.is_dir())):
        for kind in kinds_in(place):
            try:
                yield _past(place, kind.load(place))
            except InputError as problem:
                # A list of runs must not fail because one of them was interrupted while it was written.
                print(printable(f"left out: {problem}"), file=sys.stderr)


def _past(place: Path, loaded: Loaded) -> Past:
    head = loaded.head
    made = head.timing.start[:16].replace("T", " ")
    name = type(loaded).__name__.lower()
    return Past(str(place), name, head.controller.file, head.protocol, head.seed, loaded.V, loaded.rank.holds, made)


def _parser() -> Parser:
    parser = Parser("runs", "List past runs with their V and date.", EXAMPLES)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="where runs are (default: runs)")
    output.add_options(parser, "the runs")
    return parser
