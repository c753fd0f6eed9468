"""Simulating again what a report shows in full. A case is deterministic, so this is the very one evaluated."""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import closing

from ..documents.recording import Recording
from ..execution import pool
from ..execution.job import Done
from ..pairing import work
from ..pairing.pairing import GROUP_SIZE, START_TIME, Pairing
from .selection import CaseToShow

LARGEST = 1 << 22
"""Bytes of the largest recording, whose signals are thinned out."""


def record_shown(wanted: Sequence[CaseToShow], pairing: Pairing, workers: int) -> tuple[Recording, ...]:
    """Simulate what a report shows, on ``workers`` processes.

    What fails before its first sample, or takes its process with it, is left out: its status stands in the results.
    """
    count = max(workers, math.ceil(len(wanted) / GROUP_SIZE))
    groups = [group for first in range(count) if (group := wanted[first::count])]
    jobs = [
        pairing.job(
            work.record_case.__name__,
            [work.RecordTask(pairing.setup, each.case, each.roles) for each in group],
            [each.case.scenario for each in group],
            lambda _, value: work.recording(value),
            START_TIME,
            LARGEST,
        )
        for group in groups
    ]
    found: dict[int, Recording] = {}
    with closing(pool.run(jobs, workers)) as outcomes:
        for number, outcome in outcomes:
            if isinstance(outcome, Done):
                found[number + outcome.index * count] = outcome.value
    return tuple(found[number] for number in sorted(found))
