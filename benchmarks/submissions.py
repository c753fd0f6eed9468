"""The table of others' controllers on docs/publishing.md, from the certificates in submissions/."""

from __future__ import annotations

import hashlib
import re
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from orchestrator import InputError, Verification  # noqa: E402
from orchestrator.benchmark.certificate import Figure  # noqa: E402
from orchestrator.documents.verification import differences  # noqa: E402
from orchestrator.views.units import SHOWN, number  # noqa: E402

SUBMISSIONS, VERIFIED = ROOT / "submissions", ROOT / "docs" / "publishing.md"
"""Folders of others' controllers, each with its certificate; and where their table stands."""

BASELINE = "DiagonalPID"
HELD = {True: "holds", False: "fails", None: "not judged"}
"""The verdict on a requirement, as a word of the tables."""

VERIFIED_HEAD = (
    "| controller | V | reference | V strict | reference | A1 A2 A3 | B5 mm | B6 s | B7 mm | draws | result |\n"
    + 11 * "|---"
    + "|\n"
)

NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9 ._+-]{0,39}")
"""What a submission may be called: nothing that a table or a page could take for markup."""


class Submission(NamedTuple):
    """A certificate by the name of its folder; ``repeated`` if a maintainer has repeated it."""

    name: str
    known: Verification
    repeated: bool


def submissions(folder: Path) -> list[Submission]:
    """The certificates in the folders inside ``folder``, those that are repeated first, then the best.

    Raises :class:`InputError` for one that is damaged, not complete or not of the standard conditions, has neither its
    FMU nor a recipe beside it, or a ``repeat.json`` that does not agree with it.
    """
    found = []
    for place in sorted(path for path in folder.glob("*") if path.is_dir()):
        known = Verification.load(place / "verification.json")
        hashes = [hashlib.sha256(file.read_bytes()).hexdigest() for file in place.glob("*.fmu")]
        if not NAME.fullmatch(place.name):
            raise InputError("A submission has a name of letters, digits, spaces and . _ + -.", "submission", place)
        if not known.complete or known.cost.mean is None:
            raise InputError(f"{place.name}: the verification is not complete.", "submission", place)
        if known.deviations:
            raise InputError(f"{place.name} is not standard: {'; '.join(known.deviations)}.", "submission", place)
        if hashes != [known.controller.sha256] and (hashes or not (place / "README.md").is_file()):
            raise InputError(f"{place.name} has neither the FMU of its certificate nor a recipe.", "submission", place)
        repeated = (place / "repeat.json").is_file()
        if repeated:
            results, _ = differences(known, Verification.load(place / "repeat.json"))
            if results:
                raise InputError(f"{place.name}: its repetition differs: {results[0]}.", "submission", place)
        found.append(Submission(place.name, known, repeated))
    return sorted(found, key=place_of)


def place_of(submission: Submission) -> tuple[bool, bool, float]:
    """What the order of submissions goes by."""
    held = all(entry.passed for entry in submission.known.requirements.values())
    return not submission.repeated, not held, submission.known.cost.mean or 0.0


def verified_table(found: Sequence[Submission]) -> str:
    """The table of the submissions; mean and standard deviation over the draws."""
    lines = []
    for name, known, repeated in found:
        verdicts = " ".join(HELD[entry.passed] for entry in known.requirements.values())
        values = " | ".join(
            spread(known.criteria[key], SHOWN[known.criteria[key].unit].factor) for key in ("B5", "B6", "B7")
        )
        words = "repeated" if repeated else "claimed"
        compared = (known, known.references[BASELINE])
        cells = (*(spread(of.cost) for of in compared), *(spread(of.strict.cost) for of in compared if of.strict))
        lines.append(f"| {name} | {' | '.join(cells)} | {verdicts} | {values} | {known.entropy.source} | {words} |\n")
    return VERIFIED_HEAD + "".join(lines)


def spread(figure: Figure, factor: float = 1.0) -> str:
    """Mean and standard deviation."""
    return number(figure.mean, factor) + ("" if figure.sd is None else f" ± {number(figure.sd, factor)}")
