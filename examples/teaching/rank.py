"""Rank the FMUs of a folder by the same draws, which nobody knew before the hand-in, and write one page.

python examples/teaching/rank.py hand-in                       # writes ranking/ranking.html
python examples/teaching/rank.py hand-in                       # once more, after a power cut: goes on

An FMU whose variables have other names comes with a mapping file beside it, ada.toml or ada.ssm for ada.fmu, as the
option --mapping of the other commands takes it.

The first call closes the hand-in: it lists the files with their SHA-256 in hand-in.json, and draws 256 bits. The seeds
follow from both. Each controller runs apart from plant, noise and judge, in the sandbox, as in a verification. What is
finished is kept: a call that was killed costs the simulations that were under way.

exit codes: 0 every FMU has its place or the reason why it has none, 1 this machine failed for some: call it again,
2 bad input, 130 interrupted
"""

from __future__ import annotations

import hashlib
import sys
from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from filelock import FileLock, Timeout

from orchestrator import Benchmark, Controller, Crash, FmuError, InputError, Spread
from orchestrator.benchmark.certificate import seeds
from orchestrator.benchmark.draws import Entropy, fresh
from orchestrator.bounded import read
from orchestrator.cli import output
from orchestrator.cli.guard import EXIT_INCOMPLETE, EXIT_OK, guarded
from orchestrator.cli.serve import fenced
from orchestrator.cli.values import MAX_LIMIT, Parser, number
from orchestrator.codec import Malformed, Struct, from_json, to_json
from orchestrator.documents.comparison import Comparison, compare
from orchestrator.documents.document import Displayable
from orchestrator.documents.files import prepare_folder, write_text
from orchestrator.documents.spread import mean_words, spread_reasons
from orchestrator.documents.verification import COUNT, PROTOCOL
from orchestrator.pairing.pairing import Pairing
from orchestrator.text import printable
from orchestrator.views.table import Column, Facts, Note, Page, Part, Summary, Table

PAGE, HAND_IN, RUNS, LOCK = "ranking.html", "hand-in.json", "runs", ".lock"


class HandIn(Struct):
    """What was handed in: the SHA-256 of each file by its name; the protocol it is ranked by; and the bits that were
    drawn after that."""

    files: dict[str, str]
    protocol: str
    entropy: Entropy

    @property
    def fmus(self) -> list[str]:
        """The names of the FMUs, without the mappings."""
        return sorted(filter(is_fmu, self.files))

    @property
    def seeds(self) -> tuple[int, ...]:
        """Those of the draws. They follow from all files, so that no file could be made for them."""
        listed = "".join(f"{digest} {name}\n" for name, digest in sorted(self.files.items()))
        return seeds(self.entropy, hashlib.sha256(listed.encode()).hexdigest(), COUNT)


@dataclass(frozen=True)
class Entry:
    """An FMU with its results, or with the ``reason`` why it has none; ``again`` if that lies with this machine."""

    name: str
    spread: Spread | None
    reason: str = ""
    again: bool = False

    @property
    def told(self) -> str:
        """What came of it, in a line."""
        if self.spread is None or self.spread.rank.reason:
            return printable(f"{self.name}: {self.reason or 'no V'}")
        return printable(f"{self.name}: V = {mean_words(self.spread.cost)}")


@dataclass(frozen=True)
class Ranking(Displayable):
    """The places of those that are evaluated so far, and of ``left`` others none yet."""

    hand_in: HandIn
    entries: tuple[Entry, ...]
    left: int
    sandbox: bool

    def summary(self) -> Summary:
        """Facts, places, and why an FMU has none."""
        where = "in a sandbox" if self.sandbox else "WITHOUT A SANDBOX"
        told = (
            ("FMUs", f"{len(self.entries)} of {len(self.hand_in.fmus)}"),
            ("Controllers ran", f"apart from plant, noise and judge, {where}"),
            ("Entropy", self.hand_in.entropy.value),
            ("Seeds of the draws", ",".join(map(str, self.hand_in.seeds))),
        )
        parts: list[Part] = [Note(f"{self.left} FMUs are not evaluated yet.")] if self.left else []
        parts += [*self._places.summary().parts, *self._without_place(), Facts("Draws", told)]
        return Summary("Ranking", f"protocol {self.hand_in.protocol}, {COUNT} draws made after the hand-in", (*parts,))

    def page(self) -> Page:
        """The summary, and the charts of a comparison."""
        page, summary = self._places.page(), self.summary()
        first, *charts = page.panels
        return Page(summary.title, summary.kicker, (replace(first, title="Ranking", parts=summary.parts), *charts))

    @property
    def _places(self) -> Comparison:
        return compare([entry.spread for entry in self.entries if entry.spread])

    def _without_place(self) -> Iterator[Table]:
        """Why requirements are not met or not judged, and which FMUs were not evaluated."""
        failing = [(entry.name, text) for entry in self.entries if entry.spread for text in shortcomings(entry.spread)]
        refused = [(entry.name, printable(entry.reason)) for entry in self.entries if not entry.spread]
        for title, rows in (("Not met, or not judged", failing), ("Not evaluated", refused)):
            if rows:
                yield Table(title, (Column("FMU"), Column("reason")), tuple(rows))


def shortcomings(spread: Spread) -> Iterator[str]:
    """How cases ended that were not simulated, and the requirements that are not met or not judged."""
    for score in spread.incomplete:
        ended = ", ".join(f"{count} {status}" for status, count in score.ended.items())
        yield f"cases with seed {score.seed}: {ended}"
    for reason in spread_reasons(spread):
        yield reason.text


@dataclass(frozen=True)
class Apart(Benchmark):
    """The benchmark with each simulation's controller in a process of its own, as in a verification. Its numbers are
    those of ``evaluate``, but for a controller that would reach for the judge's."""

    def pairing(self, controller: Controller) -> Pairing:
        """See :meth:`.Testbed.pairing`."""
        return replace(super().pairing(controller), isolated=True)


def handed_in(folder: Path) -> dict[str, str]:
    """The SHA-256 of the FMUs in ``folder`` by name, and of the mappings beside them; raises :class:`InputError` if
    there are none. Links, which could lead anywhere, are none."""
    if not folder.is_dir():
        raise InputError(f"There is no folder {folder}.", "no-folder", folder)
    there = [file for file in sorted(folder.iterdir()) if file.is_file() and not file.is_symlink()]
    fmus = [file for file in there if is_fmu(file.name)]
    if not fmus:
        raise InputError(f"The folder {folder} holds no FMU.", "no-file", folder)
    mappings = {file.with_suffix(suffix) for file in fmus for suffix in MAPPINGS} & {*there}
    return {file.name: hashlib.sha256(read(file, MAX_FMU_BYTES)).hexdigest() for file in (*fmus, *mappings)}


def is_fmu(name: str) -> bool:
    """Whether the file of this name is an FMU, and not the mapping of one."""
    return name.lower().endswith(".fmu")


MAPPINGS = (".toml", ".ssm")
"""How the name of a mapping ends, which is that of its FMU otherwise."""


MAX_FMU_BYTES = 1 << 30
"""The largest file that is taken."""


def closed(folder: Path, protocol: str, place: Path) -> HandIn:
    """The hand-in of ``folder``: as it was closed before, or closed now.

    Raises :class:`InputError` if other files were there then: who hands in later may know the draws.
    """
    files, record = handed_in(folder), place / HAND_IN
    if not record.exists():
        write_text(record, to_json(HandIn(files, protocol, fresh())))
    try:
        before = from_json(read(record), HandIn)
    except Malformed as problem:
        raise InputError(f"{record} is no list of a hand-in: {problem}.", "bad-file", record) from None
    if (before.files, before.protocol) != (files, protocol):
        others = sorted(name for name in {**before.files, **files} if before.files.get(name) != files.get(name))
        message = f"{record} was closed with other files or another protocol ({', '.join(others) or before.protocol}). "
        message += "Give them back, or choose another folder with --output-dir, which has other draws."
        raise InputError(message, "other-hand-in", record)
    return before


def controller(file: Path, handed_in: Collection[str]) -> Controller:
    """The controller of an FMU, with the mapping that was handed in beside it."""
    beside = [mapping for suffix in MAPPINGS if (mapping := file.with_suffix(suffix)).name in handed_in]
    if len(beside) > 1:
        raise InputError(f"{file.name} has more than one mapping beside it.", "bad-mapping", file)
    return Controller(file, mapping=beside[0]) if beside else Controller(file)


def entry(bench: Benchmark, file: Path, place: Path, hand_in: HandIn) -> Entry:
    """The results of one FMU, those of an earlier call if they are there. Nothing that it does is raised."""
    try:
        known = Spread.load(place) if (place / Spread.FILE).is_file() else None
        if known is None or not is_final(known, hand_in.seeds):
            one = controller(file, hand_in.files)
            known = bench.spread(one, hand_in.seeds, folder=place, recordings=False)
        return Entry(file.name, known, again=not is_final(known, hand_in.seeds))
    except (InputError, FmuError, Crash) as problem:
        return Entry(file.name, None, str(problem), isinstance(problem, Crash) and problem.what == "killed")
    # All others must have their places in the morning, whatever this one has made of the machine or found in us.
    except Exception as problem:
        return Entry(file.name, None, f"tried again by the next call: {type(problem).__name__}: {problem}", again=True)


def is_final(spread: Spread, drawn: Sequence[int]) -> bool:
    """Whether all draws are there, and no case of them was lost to something else than the controller."""
    scores = (*spread.seeds, *spread.incomplete)
    return {score.seed for score in scores} == {*drawn} and not any("lost" in score.ended for score in scores)


def main(arguments: Sequence[str] | None = None) -> int:
    """Rank, and return the exit code."""
    given = _parser().parse_args(arguments)
    sandbox, _ = fenced(given.trust, several=True)
    bench = Apart(given.protocol, timeout=given.timeout, sandbox=sandbox)
    _ = bench.rules, bench.manipulator  # what is wrong with these is no FMU's fault
    prepare_folder(given.output_dir)
    try:
        with FileLock(given.output_dir / LOCK).acquire(timeout=0):
            ranking = _ranked(bench, given.folder, given.output_dir)
    except Timeout:
        raise InputError(f"Another call ranks into {given.output_dir}.", "folder-in-use", given.output_dir) from None
    output.put(ranking, given)
    output.tell_written(given.output_dir, [PAGE])
    return EXIT_INCOMPLETE if any(entry.again for entry in ranking.entries) else EXIT_OK


def _ranked(bench: Benchmark, folder: Path, place: Path) -> Ranking:
    hand_in = closed(folder, str(bench.protocol), place)
    ranking = Ranking(hand_in, (), len(hand_in.fmus), bench.sandbox)
    for name in hand_in.fmus:
        found = entry(bench, folder / name, place / RUNS / name, hand_in)
        ranking = replace(ranking, entries=(*ranking.entries, found), left=ranking.left - 1)
        ranking.report(place / PAGE)
        print(f"{len(ranking.entries)} of {len(hand_in.fmus)}: {found.told}", file=sys.stderr, flush=True)
    return ranking


def _parser() -> Parser:
    summary, _, details = (__doc__ or "").partition("\n\n")
    parser = Parser("rank", summary, details, program="python examples/teaching/rank.py")
    parser.add_argument("folder", type=Path, metavar="FOLDER", help="the FMUs that were handed in")
    parser.add_argument("--protocol", default=PROTOCOL, metavar="NAME", help=f"what is run once per draw ({PROTOCOL})")
    parser.add_argument("--trust", action="store_true", help="run FMUs without a sandbox, with your permissions")
    parser.add_argument(
        "--timeout",
        type=number(most=MAX_LIMIT, above=0.0),
        default=20.0,
        metavar="S",
        help="processor time of a simulation of 26 s (default: 20)",
    )
    parser.add_argument(
        "--output-dir", type=Path, default=Path("ranking"), metavar="FOLDER", help="results (default: ranking)"
    )
    output.add_options(parser, "the ranking")
    return parser


if __name__ == "__main__":
    raise SystemExit(guarded(main))
