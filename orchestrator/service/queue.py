"""What runs next: people in turn, and short stages before long ones."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence

from .records import SHORT, Submission
from .states import waits


def chosen(
    waiting: Iterable[Submission],
    running: Sequence[Submission],
    served: Mapping[str, float],
    evaluations: int,
    now: float,
) -> Submission | None:
    """The run whose next stage begins now; None if nothing may.

    There is room for as many ``evaluations`` at a time, and for one short stage more: who uploads an FMU has its check
    and its first score while the evaluations of others last. Of those that wait, the person comes next who was
    ``served`` longest ago: who uploads a hundred FMUs delays another one's first by one stage, not by a hundred.
    """
    if len(running) > evaluations:
        return None
    long = sum(run.stage not in SHORT for run in running)
    ready = (run for run in waiting if not waits(run, now) and (run.stage in SHORT or long < evaluations))
    return min(ready, key=lambda run: (run.stage not in SHORT, served.get(run.owner, 0.0), run.created), default=None)


def places(waiting: Iterable[Submission], served: Mapping[str, float]) -> dict[str, int]:
    """How many stages of the same length begin before that of each run, if nobody comes in between; by the run's id."""
    left: dict[bool, dict[str, list[Submission]]] = {True: {}, False: {}}
    for run in sorted(waiting, key=lambda run: run.created):
        left[run.stage in SHORT].setdefault(run.owner, []).append(run)
    place: dict[str, int] = {}
    for queues in left.values():
        turn, number = sorted(queues, key=lambda owner: (served.get(owner, 0.0), queues[owner][0].created)), 0
        while turn:
            for owner in turn:
                place[queues[owner].pop(0).id] = number
                number += 1
            turn = [owner for owner in turn if queues[owner]]
    return place
