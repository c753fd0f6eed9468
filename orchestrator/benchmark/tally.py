"""How the cases of a requirement ended: the verdict that follows from them, and its reason in words."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping
from typing import Any, Literal, get_args

from ..codec import Natural, Struct

Failure = Literal["crashed", "timeout", "error", "left the workspace", "no rest", "limit cycle", "given up"]
"""How a case of a requirement fails. All of these are the controller's; it is "given up" in a verification, after
failures in others."""

Unjudged = Literal["skipped", "lost", "not run"]
"""Why a case says nothing about the controller."""

UNJUDGED: tuple[Unjudged, ...] = get_args(Unjudged)

Outcome = Failure | Unjudged | Literal["holds"]

MEASURED: frozenset[Failure] = frozenset({"no rest", "limit cycle"})
"""Failures with an amplitude; of the others, none is worse than another."""

VERBS: Mapping[Outcome, str] = {
    "crashed": "ended with `crashed`",
    "timeout": "ended with `timeout`",
    "error": "ended with `error`",
    "left the workspace": "left the workspace",
    "no rest": "did not come to rest",
    "limit cycle": "had a limit cycle",
    "given up": "ended with `skipped` after other failures",
    "skipped": "ended with `skipped`",
    "lost": "ended with `lost`",
}


class Tally(Struct):
    """The ``cases`` that a requirement asks for, and of these, by how they ended, those that ``failed`` and those that
    are ``not_judged``: skipped, lost to something else than the controller, or not run.

    ``first`` names the worst case that failed, the first one of equals; if none failed, the first one that was skipped
    or lost; it is empty if there is neither.
    """

    cases: Natural = 0
    failed: dict[Failure, Natural] = {}
    not_judged: dict[Unjudged, Natural] = {}
    first: str = ""

    @property
    def passed(self) -> bool | None:
        """The verdict: False if a case failed, else None if a case is not judged or there is none, else True."""
        if self.failed:
            return False
        return None if self.not_judged or not self.cases else True

    @property
    def interrupted(self) -> bool:
        """Whether there is no verdict since a case was skipped or lost, not merely since it was not asked for."""
        return self.passed is None and not self.not_judged.keys() <= {"not run"}


def tally(outcomes: Iterable[Outcome], expected: int, first: str = "") -> Tally:
    """The tally of the ``outcomes`` of a requirement's cases, of which ``expected`` are asked for."""
    counts = Counter[str](outcomes)
    cases = max(expected, counts.total())
    counts["not run"] += cases - counts.total()
    return _of(cases, counts, first)


def merged(tallies: Iterable[Tally], first: str = "") -> Tally:
    """The tally over several draws or seeds, each with its own."""
    counts, cases = Counter[str](), 0
    for part in tallies:
        cases += part.cases
        counts.update(part.failed)
        counts.update(part.not_judged)
    return _of(cases, counts, first)


def with_given_up(counted: Tally) -> Tally:
    """The tally in which cases that were skipped have failed.

    In a verification nothing but failures of the controller itself makes that other cases are skipped; which ones
    follows from the order of the cases, which says nothing about a requirement.
    """
    counts: dict[str, int] = {
        name: count for group in (counted.failed, counted.not_judged) for name, count in group.items()
    }
    skipped = counts.pop("skipped", 0)
    return _of(counted.cases, {**counts, "given up": counts.get("given up", 0) + skipped}, counted.first)


def _of(cases: int, counts: Mapping[str, int], first: str) -> Tally:
    failed: dict[Failure, int] = {name: counts[name] for name in get_args(Failure) if counts.get(name)}
    unjudged: dict[Unjudged, int] = {name: counts[name] for name in UNJUDGED if counts.get(name)}
    return Tally(cases, failed, unjudged, first)


def reason(counted: Tally) -> str:
    """Why a requirement is not met or not judged, such as "3 of 36 cases ended with `timeout`, first
    c04.sticky.gain_1"; empty if it is met."""
    if counted.passed:
        return ""
    if not counted.cases:
        return "the protocol has no case for it"
    counts: Mapping[Any, int] = counted.failed or counted.not_judged
    total, ended = sum(counts.values()), [f"{count} {_verb(name, count)}" for name, count in counts.items()]
    text = f"{total} of {counted.cases} cases "
    if len(ended) == 1:
        text += ended[0].removeprefix(f"{total} ")
    else:
        text += ("failed" if counted.failed else "were not judged") + f" ({', '.join(ended)})"
    if counted.first:
        text += f", {'worst' if counted.failed and counted.failed.keys() <= MEASURED else 'first'} {counted.first}"
    if counted.failed and counted.not_judged:
        rest = sum(counted.not_judged.values())
        text += f"; {rest} more {_be(rest)} not judged"
    return text


def _verb(name: Outcome, count: int) -> str:
    return VERBS.get(name) or f"{_be(count)} not run"


def _be(count: int) -> str:
    return "was" if count == 1 else "were"
