"""Why requirements are not met or not judged, each in one line with what to do: what all outputs say."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

from ..loop.trajectory import Status
from ..views.table import VERDICTS, Note

SHOWN_FAILURES = 3
"""Cases that failed whose messages a summary shows."""


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
    return tuple(Note(str(reason), warning=False) for reason in reasons)


def failure_notes(failed: Sequence[tuple[str, Status, str]], file: str) -> tuple[Note, ...]:
    """The names, statuses and messages of the first cases that ``failed``; ``file`` has the others."""
    notes = [Note(f"{name}: {status.value}: {message}") for name, status, message in failed[:SHOWN_FAILURES]]
    more = (
        [Note(f"... and {len(failed) - SHOWN_FAILURES} more; see {file}.", warning=False)]
        if len(failed) > SHOWN_FAILURES
        else []
    )
    return *notes, *more
