"""What counts in a round, and which place it has: pure functions of what people have handed in."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Literal

from . import states
from .records import HandIn, Round, State, Submission

Phase = Literal["open", "verifying", "final"]
"""Where a round is. One that is open has no bits; one that is closed has them for good, and is final when nothing of it
is left to verify."""


def phase(round: Round, runs: Iterable[Submission]) -> Phase:
    """The phase of a round, by the ``runs`` that count in it."""
    if round.closed is None:
        return "open"
    return "verifying" if any(run.state is State.VERIFYING for run in runs) else "final"


def counted(chosen: Iterable[HandIn], handed_in: Sequence[Submission]) -> dict[str, Submission]:
    """The one run of each person that counts, by its owner: what was ``chosen``, else the latest of those
    ``handed_in``, the oldest upload first. A choice that is deleted or has not finished is none. Of what was handed in,
    those of :meth:`.Database.may_count` do."""
    latest = {run.owner: run for run in handed_in}
    by_id = {run.id: run for run in handed_in}
    runs = {entry.owner: by_id[entry.run] for entry in chosen if entry.run in by_id}
    return {**latest, **{owner: run for owner, run in runs.items() if run.owner == owner}}


def closed(
    round: Round, counting: Mapping[str, Submission], names: Mapping[str, str], bits: str, now: float
) -> tuple[Round, tuple[HandIn, ...], tuple[tuple[Submission, Submission, str], ...]]:
    """A round at its close, with the ``bits`` that were just drawn: what counts, and each run before and after, which
    is to be verified; ``names`` are those of people."""
    entries = tuple(HandIn(owner, run.id, names.get(owner, ""), run.name) for owner, run in counting.items())
    changes = tuple((run, *states.chosen(run, round.id)) for run in counting.values())
    return replace(round, closed=now, bits=bits), entries, changes


def places(runs: Iterable[Submission]) -> dict[str, int]:
    """The places of verified runs by their ids: first those that meet all requirements in all draws, then by the mean
    of V. Equal ones share a place; who could not be verified has none."""
    keys = {
        run.id: (run.drawn_holds is not True, run.drawn_cost)
        for run in runs
        if run.state is State.FINISHED and run.drawn_cost is not None and not run.drawn_remark
    }
    return {id: 1 + sum(other < key for other in keys.values()) for id, key in keys.items()}
