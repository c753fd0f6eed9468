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
    and its first score while the evaluations of others last. Where no evaluation waits, its place is for short stages,
    too. Of those that wait, the person comes next who was ``served`` longest ago: who uploads a hundred FMUs delays
    another one's first by one stage, not by a hundred.
    """
    if len(running) > evaluations:
        return None
    ready = [run for run in waiting if not waits(run, now)]
    short = [run for run in ready if run.stage in SHORT]
    long = [run for run in ready if run.stage not in SHORT]
    of_long = sum(run.stage not in SHORT for run in running)
    # One short stage at a time while a long one may begin: the checks of 20 uploads would else hold it back.
    if long and of_long < evaluations and (len(running) > of_long or not short):
        short = long
    return min(short, key=lambda run: (served.get(run.owner, 0.0), run.created), default=None)


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
