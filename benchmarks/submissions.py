"""The table of others' controllers on docs/publishing.md, from the certificates in submissions/."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import NamedTuple
from urllib.parse import quote

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from build_fmus import KNOWN  # noqa: E402
from orchestrator import InputError, Verification  # noqa: E402
from orchestrator.benchmark.certificate import Figure  # noqa: E402
from orchestrator.documents.files import VERIFICATION  # noqa: E402
from orchestrator.documents.verification import differences  # noqa: E402
from orchestrator.views.units import SHOWN, number  # noqa: E402

SUBMISSIONS, REPETITIONS, VERIFIED = ROOT / "submissions", ROOT / "repetitions", ROOT / "docs" / "publishing.md"
"""Folders of others' controllers, each with its certificate; the certificates with which maintainers have repeated
these, as NAME.json; and where their table stands."""

BASELINE = "DiagonalPID"
HELD = {True: "✓", False: "✗", None: "–"}
"""The verdict on a requirement, as a mark of the tables."""

LEGEND = "✓: holds, ✗: fails, –: not judged."

VERIFIED_HEAD = (
    "| controller | V | reference | V strict | reference | A1 A2 A3 | B5 mm | B6 s | B7 mm | draws | result |\n"
    + 11 * "|---"
    + "|\n"
)

NAME = re.compile(r"[A-Za-z0-9](?:[A-Za-z0-9 ._+-]{0,38}[A-Za-z0-9+])?")
"""What a submission may be called: nothing that a table or a page could take for markup, or that reads as another."""


class Submission(NamedTuple):
    """A certificate by the name of its folder; ``repeated`` if a maintainer has repeated it."""

    name: str
    known: Verification
    repeated: bool


def submissions(folder: Path, repetitions: Path = REPETITIONS) -> list[Submission]:
    """The certificates in the folders inside ``folder``, those that are repeated first, then the best.

    Raises :class:`InputError` for one that is damaged, not complete or not of the standard conditions, has neither its
    FMU nor a recipe beside it, takes the name or the controller of another, or whose repetition does not agree with it.
    """
    found: list[Submission] = []
    for place in sorted(path for path in folder.glob("*") if path.is_dir()):
        _check_files(place)
        known = Verification.load(place / "verification.json")
        if not known.complete or known.cost.mean is None:
            raise InputError(f"{place.name}: the verification is not complete.", "submission", place)
        if known.deviations:
            raise InputError(f"{place.name} is not standard: {'; '.join(known.deviations)}.", "submission", place)
        hashes = [hashlib.sha256(file.read_bytes()).hexdigest() for file in place.glob("*.fmu")]
        if hashes != [known.controller.sha256] and (hashes or not (place / "README.md").is_file()):
            raise InputError(f"{place.name} has neither the FMU of its certificate nor a recipe.", "submission", place)
        if same := next((each.name for each in found if _is_same(each.known, known)), ""):
            raise InputError(f"{place.name} is the controller of {same}.", "submission", place)
        repeated = repetitions / f"{place.name}.json"
        if repeated.is_file():
            _check_repetition(known, repeated)
        found.append(Submission(place.name, known, repeated.is_file()))
    return sorted(found, key=place_of)


def _check_files(place: Path) -> None:
    """Raise :class:`InputError` for a name that is not its own, a link, or a repetition by the author."""
    if not NAME.fullmatch(place.name):
        message = "A submission has a name of letters, digits, spaces and . _ + -, which begins and ends with a letter "
        raise InputError(f"{message}or a digit.", "submission", place)
    others = (*KNOWN, *(each.name for each in place.parent.iterdir() if each != place))
    if place.name.casefold() in map(str.casefold, others):
        raise InputError(f"{place.name} is the name of another controller.", "submission", place)
    if any(path.is_symlink() for path in (place, *place.rglob("*"))):
        raise InputError(f"{place.name} has a link in its folder.", "submission", place)
    if (place / "repeat.json").exists():
        message = f"{place.name} has a repetition in its own folder; that of a maintainer lies in {REPETITIONS.name}/."
        raise InputError(message, "submission", place)


def _check_repetition(known: Verification, file: Path) -> None:
    """Raise :class:`InputError` for what is no repetition of ``known`` under the standard conditions."""
    repeated = Verification.load(file)
    results, _ = differences(known, repeated)
    if results:
        raise InputError(f"{file.stem}: its repetition differs: {results[0]}.", "submission", file)
    if repeated.deviations:
        raise InputError(f"{file.stem}: its repetition is not standard: {repeated.deviations[0]}.", "submission", file)
    if repeated.timing == known.timing:
        raise InputError(f"{file.stem}: its repetition is a copy of it.", "submission", file)


def _is_same(one: Verification, other: Verification) -> bool:
    """Whether two certificates are of one controller."""
    first, second = one.controller, other.controller
    used = (first.parameters, first.mapping) == (second.parameters, second.mapping)
    return used and first.sha256 == second.sha256


def place_of(submission: Submission) -> tuple[bool, bool, float]:
    """What the order of submissions goes by."""
    held = all(entry.passed for entry in submission.known.requirements.values())
    return not submission.repeated, not held, submission.known.cost.mean or 0.0


def held(verdicts: Mapping[str, bool | None]) -> str:
    """A mark behind the name of each requirement."""
    return ", ".join(f"{name} {HELD[passed]}" for name, passed in verdicts.items())


def verified_table(found: Sequence[Submission]) -> str:
    """The table of the submissions, each name a link to its certificate; mean and standard deviation over the draws."""
    lines = []
    for name, known, repeated in found:
        verdicts = held({name: entry.passed for name, entry in known.requirements.items()})
        values = " | ".join(
            spread(known.criteria[key], SHOWN[known.criteria[key].unit].factor) for key in ("B5", "B6", "B7")
        )
        words = "repeated" if repeated else "claimed"
        compared = (known, known.references[BASELINE])
        cells = (*(spread(of.cost) for of in compared), *(spread(of.strict.cost) for of in compared if of.strict))
        link = f"[{name}](../{SUBMISSIONS.name}/{quote(name)}/{VERIFICATION})"
        lines.append(f"| {link} | {' | '.join(cells)} | {verdicts} | {values} | {known.entropy.source} | {words} |\n")
    return VERIFIED_HEAD + "".join(lines)


def spread(figure: Figure, factor: float = 1.0) -> str:
    """Mean and standard deviation."""
    return number(figure.mean, factor) + ("" if figure.sd is None else f" ± {number(figure.sd, factor)}")
