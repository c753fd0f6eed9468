"""The commands ``report``, ``compare`` and ``runs``: finished results of any kind, from the folders they were written
into."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

from ..codec import to_json
from ..documents import compare_page, comparison
from ..documents.comparability import Entry
from ..documents.document import Displayable
from ..documents.evaluation import Evaluation
from ..documents.files import FIGURES, REPORT, RESULTS, SIMULATION, prepare_folder
from ..documents.recording import EXAMPLE, Recording, record
from ..documents.reliability import Reliability
from ..documents.robustness import Robustness
from ..documents.spread import Spread
from ..documents.sweep import Sweep
from ..documents.tuning import Tuning
from ..documents.verification import Verification
from ..errors import InputError
from ..text import printable
from ..views.table import Cell, Column, Summary, Table
from . import output
from .guard import EXIT_OK
from .values import Parser, widths

# Imports inside functions: only `report` writes what the commands of the studies write, which take a second to load.

Loaded = Evaluation | Spread | Robustness | Reliability | Tuning | Sweep | Verification

KINDS: dict[str, type[Loaded]] = {
    RESULTS: Evaluation,
    **{kind.FILE: kind for kind in (Spread, Robustness, Reliability, Tuning, Sweep, Verification)},
}
"""What a folder may hold, by the name of the file."""


def kinds_in(path: Path) -> list[type[Loaded]]:
    """The kinds of results that a folder holds, or the kind of a file."""
    return [kind for name, kind in KINDS.items() if path.name == name or (path / name).is_file()]


def _nothing_in(path: Path) -> str:
    """What a folder holds in place of results."""
    if (path / SIMULATION).is_file():
        return f"{path} holds the simulation of one case, which has no V."
    return f"{path} holds no results of a known kind: {', '.join(KINDS)}."


def finished(paths: Sequence[Path]) -> list[tuple[Loaded, Path]]:
    """The finished results of every kind in these folders or files.

    A folder without results is left out, with a note on standard error. If no folder has results, the last reason is
    raised, an :class:`InputError`.
    """
    loaded: list[tuple[Loaded, Path]] = []
    last: InputError | None = None
    for path in paths:
        try:
            kinds = kinds_in(path)
            if not kinds and path.is_dir():
                raise InputError(_nothing_in(path), "no-run", path)
            loaded += [(kind.load(path), path) for kind in kinds or (Evaluation,)]
        except InputError as problem:
            last = problem
            # One folder alone is what was meant, so its error is raised; of several, a shell's pattern may name others.
            if len(paths) > 1:
                print(printable(f"left out: {problem}"), file=sys.stderr)
    if not loaded and last is not None:
        raise last
    return loaded


REPORT_EXAMPLES = """examples:
  flexible-manipulator report runs/DiagonalPID-paper              # report.html again
  flexible-manipulator report runs/DiagonalPID-paper --figures    # and the paper's figures
  flexible-manipulator report runs/DiagonalPID-strict-robustness  # the report of a search, a tuning, several seeds, ...
  flexible-manipulator report runs/DiagonalPID-paper --latex --no-report

exit codes: 0 written, 1 something cannot be written, 2 a folder holds no results, 3 written, but a requirement is not
judged since cases were skipped or lost"""


def report(arguments: Sequence[str] | None = None) -> int:
    """Show finished results again: tables, report, figures. Nothing is simulated."""
    from .evaluate import add_files, check_files, write_files

    parser = Parser("report", "Show finished results of any kind again, from the files they wrote.", REPORT_EXAMPLES)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="FOLDER", help="a folder of results, such as runs/DiagonalPID-paper"
    )
    add_files(parser)
    parser.add_argument("--no-report", action="store_true", help="write no report.html")
    output.add_dry_run(output.add_options(parser, "the JSON document"), "what would be written")
    given = parser.parse_args(arguments)
    check_files(given)
    several: list[tuple[Loaded, Path]] = finished(given.runs)
    if given.json and len(several) > 1 and not given.dry_run:
        print(to_json([document.results if isinstance(document, Evaluation) else document for document, _ in several]))
    codes = []
    for number, (document, folder) in enumerate(several):
        other = not isinstance(document, Evaluation)
        if other and (given.figures or given.parquet or given.mat):
            raise InputError(f"{folder} holds no evaluation: only its report can be written.", "no-run", folder)
        place = folder if folder.is_dir() else folder.parent
        if given.dry_run:
            print(printable(f"{place}: {type(document).__name__} of {document.head.controller.file}"))
            continue
        written = _write(document, place, given.no_report)
        if isinstance(document, Evaluation):
            written += write_files(document, place, given)
        if number and given.form == "csv":
            print()
        if not given.json or len(several) == 1:
            output.put(document, given, document.results if isinstance(document, Evaluation) else None)
        output.tell_written(place, written)
        codes.append(output.shown_code(document.completeness))
    return max(codes, default=0)


def _write(document: Loaded, folder: Path, without: bool) -> list[str]:
    from .studies import sweep_files

    written = (
        [] if without or not isinstance(document, Sweep) else list(sweep_files(document, folder, argparse.Namespace()))
    )
    if without:
        return written
    document.report(folder / REPORT, folder)
    return [*written, REPORT]


COMPARE_EXAMPLES = """examples:
  flexible-manipulator compare runs/DiagonalPID-paper runs/my_controller-paper
  flexible-manipulator compare runs/*-paper --json
  flexible-manipulator compare runs/*-paper runs/*-robustness --latex --figures
  flexible-manipulator compare runs/*-paper-seeds runs/*-robustness
  flexible-manipulator compare runs/*-paper --figures --widths 88mm,180mm --case c07.compliant.disturbance

exit codes: 0 compared, 2 none of the folders holds results, 3 compared, but a requirement is not judged in one of them
since cases were skipped or lost"""


def compare(arguments: Sequence[str] | None = None) -> int:
    """Compare finished results of any kind: leaderboards in the terminal and as a page."""
    parser = Parser("compare", "Compare finished results of any kind, from the files they wrote.", COMPARE_EXAMPLES)
    parser.add_argument(
        "runs", nargs="+", type=Path, metavar="FOLDER", help="a folder of results, such as runs/MyPID-paper"
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=Path("runs") / "comparison",
        metavar="FOLDER",
        help="where to write compare.html (default: runs/comparison)",
    )
    output.add_dry_run(output.add_options(parser, "the comparison as JSON"), "what would be compared")
    group = parser.add_argument_group("figures for a paper")
    group.add_argument(
        "--figures", action="store_true", help="write figures as PDF, SVG and PNG, with their captions as LaTeX"
    )
    group.add_argument(
        "--widths",
        type=widths,
        metavar="ONE,TWO",
        help="how wide one column of the paper's text is, and two, in in, mm, cm or pt (default: 3.5in,7.16in)",
    )
    group.add_argument(
        "--columns", type=int, choices=(1, 2), help="how many columns every figure spans (default: what suits each)"
    )
    group.add_argument(
        "--case",
        action="append",
        default=[],
        metavar="ID",
        dest="cases",
        help="draw this case over time, too, such as c07.compliant.disturbance; may be given again. A run that has not "
        "recorded the case simulates it again",
    )
    given = parser.parse_args(arguments)
    if not given.figures and (given.widths or given.columns or given.cases):
        raise InputError("--widths, --columns and --case are for figures. Give --figures too.", "contradiction")
    listed = finished(given.runs)
    compared = comparison.grouped([(document, path) for document, path in listed])
    if given.dry_run:
        print("\n".join(printable(f"{group.title}: {len(group.entries)}") for group in compared))
        return 0
    prepare_folder(given.output_dir)
    compared.report(given.output_dir / compare_page.FILE)
    written = [compare_page.FILE]
    if given.figures:
        from ..documents.comparison_figures import Paper, write_comparison  # Matplotlib, which takes a second

        entries = compared.first.get(Evaluation.KIND, ())
        cases = {id: _recorded(entries, id) for id in dict.fromkeys(given.cases)}
        paper = Paper(given.widths or Paper.widths, given.columns)
        drawn, empty = write_comparison(compared.first, given.output_dir / FIGURES, paper, cases)
        written += [f"{FIGURES}/{name}" for name in drawn]
        if empty:
            print(f"not written, since there are no data for them: {', '.join(empty)}", file=sys.stderr)
    output.put(compared, given, compared.document())
    output.tell_written(given.output_dir, written)
    return max(output.shown_code(document.completeness) for document, _ in listed)


def _recorded(entries: Sequence[Entry], id: str) -> list[tuple[Entry, Recording]]:
    """The case ``id`` of every evaluation: as it was recorded, or simulated again."""
    return [
        (entry, _recording(entry.document, entry.folder, id))
        for entry in entries
        if isinstance(entry.document, Evaluation) and entry.folder is not None
    ]


def _recording(run: Evaluation, folder: Path, id: str) -> Recording:
    # Of the systems that are drawn over each other, the torques are not kept.
    there = next((entry for entry in run.recordings if entry.about.id == id and len(entry.torque)), None)
    if there is not None:
        return there
    from .simulate import again

    print(printable(f"{folder}: {id} is not recorded, and is simulated again"), file=sys.stderr)
    simulation = again(folder, id)
    return record(simulation.case, (EXAMPLE,), simulation.trajectory)


RUNS_EXAMPLES = """examples:
  flexible-manipulator runs                     # what is in the folder runs, the newest last
  flexible-manipulator runs results/*           # in other folders
  flexible-manipulator runs --json              # for a program

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


def runs(arguments: Sequence[str] | None = None) -> int:
    """List past runs: what is in a folder, with its V and when it was made."""
    given = _runs_parser().parse_args(arguments)
    folders = given.folders or [Path("runs")]
    for folder in folders:
        if not folder.is_dir():
            raise InputError(f"There is no folder {folder}.", "no-folder", folder)
    past = Runs(
        sorted((run for folder in folders for run in _past_runs(folder)), key=lambda run: (run.made, run.folder))
    )
    output.put(past, given, [run._asdict() for run in past.runs])
    return EXIT_OK


def _past_runs(folder: Path) -> Iterator[Past]:
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


def _runs_parser() -> Parser:
    parser = Parser("runs", "List past runs with their V and date.", RUNS_EXAMPLES)
    parser.add_argument("folders", nargs="*", type=Path, metavar="FOLDER", help="where runs are (default: runs)")
    output.add_options(parser, "the runs")
    return parser
