"""The page ``compare.html``: leaderboards, bars, difference maps, and the runs' worst cases laid over each other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..codec import plain
from . import pages
from .comparison import Entry, Group
from .payload import criteria, packed_worst, workspace
from .wording import requirement_rows

FILE = "compare.html"

CURVE_INTERVALS = 2500
"""Intervals that a worst case is thinned out to."""


def compare_html(groups: Sequence[Group]) -> str:
    """The comparison as one HTML file. Its figures show the runs of the first group."""
    entries = groups[0].entries
    first = entries[0].run.results
    payload = {
        **workspace(first),
        "criteria": criteria(first.criteria),
        "rules": plain(first.rules),
        "runs": [_run(entry) for entry in entries],
    }
    ranked = [[(str(rank), entry, "") for rank, entry in enumerate(group.ranked, start=1)] for group in groups]
    unranked = [[("-", entry, reason) for entry, reason in group.unranked] for group in groups]
    return pages.render(
        "compare.html",
        pages.COMPARE,
        payload,
        groups=[(group, first + last) for group, first, last in zip(groups, ranked, unranked, strict=True)],
        criteria=criteria,
        requirements=requirement_rows,
        several=len(entries) > 1,
    )


def _run(entry: Entry) -> dict[str, Any]:
    """A run for the figures: costs by configuration, and the worst case of every criterion of the TCP error."""
    results = entry.run.results
    worst = {
        name: packed_worst(recorded, CURVE_INTERVALS, results)
        for name in ("B5", "B6", "B7")
        for recorded in entry.run.recorded(name)
    }
    return {
        "name": entry.name,
        "criteria": plain(results.criteria),
        "configurations": plain(results.configurations),
        "worst": worst,
    }
