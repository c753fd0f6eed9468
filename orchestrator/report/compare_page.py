"""The page ``compare.html``: leaderboards, bars, difference maps, and the runs' worst cases laid over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from . import pages
from .comparison import Entry, Group
from .payload import criteria, packed_error, workspace
from .wording import requirement_rows

FILE = "compare.html"

CURVE_INTERVALS = 2500
"""Intervals that a worst case is thinned out to."""


def compare_html(groups: Sequence[Group]) -> str:
    """The comparison as one HTML file. Its figures show the runs of the first group."""
    entries = [entry for group in groups[:1] for entry in _entries(group)]
    first = entries[0].run
    payload = {
        **workspace(first),
        "criteria": criteria(first),
        "rules": first.document["rules"],
        "runs": [_run(entry) for entry in entries],
    }
    return pages.render(
        "compare.html",
        pages.COMPARE,
        payload,
        groups=[
            {
                "title": group.title,
                "difference": group.difference,
                "paper": group.conditions["protocol"] == "paper",
                "rows": [_row(str(rank), entry) for rank, entry in enumerate(group.ranked, start=1)]
                + [_row("-", entry, reason) for entry, reason in group.unranked],
            }
            for group in groups
        ],
        criteria=criteria(first),
        target=first.document["rules"]["cost"]["target"],
        paper=first.document["rules"]["cost"]["paper"],
        several=len(entries) > 1,
    )


def _entries(group: Group) -> list[Entry]:
    return [*group.ranked, *(entry for entry, _ in group.unranked)]


def _row(rank: str, entry: Entry, reason: str = "") -> dict[str, Any]:
    document = entry.run.document
    return {
        "rank": rank,
        "name": entry.name,
        "reason": reason,
        "cost": document["cost"],
        "criteria": criteria(entry.run),
        "requirements": requirement_rows(document),
    }


def _run(entry: Entry) -> dict[str, Any]:
    """A run for the figures: costs by configuration, and the worst case of every criterion of the TCP error."""
    worst = {
        name: packed_error(recorded, CURVE_INTERVALS)
        for name in ("B5", "B6", "B7")
        for recorded in entry.run.recorded(name)
    }
    return {
        "name": entry.name,
        "criteria": entry.run.document["criteria"],
        "configurations": entry.run.document["configurations"],
        "worst": worst,
    }
