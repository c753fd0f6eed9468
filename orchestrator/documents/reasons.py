"""Why requirements are not met or not judged, each in one line with what to do: what all outputs say."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

from ..views.table import VERDICTS, Note


class Reason(NamedTuple):
    """Why a requirement is not met, with the ``command`` that repeats its worst case, or is not judged."""

    text: str
    command: str = ""
    advice: str = ""

    def __str__(self) -> str:
        """The whole line."""
        return "; ".join(filter(None, (self.text, self.command and f"repeat with {self.command}", self.advice)))


def reason_text(name: str, passed: bool | None, where: str, why: str) -> str:
    """The verdict on a requirement, where it was found, and why."""
    return f"{' '.join(filter(None, (name, VERDICTS[passed], where)))}: {why}"


def reason_notes(reasons: Iterable[Reason]) -> tuple[Note, ...]:
    """The reasons as lines of a summary."""
    return tuple(Note(str(each), warning=False) for each in reasons)
