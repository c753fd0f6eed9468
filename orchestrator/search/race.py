"""Margins by racing: the smallest step of a scale at which any of many members fails, in few simulations."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

from .history import Asking
from .member import Member

Scale = TypeVar("Scale")

BATCH = 8
"""Members that are tried at once."""


def race(
    members: Sequence[Member],
    scale: Sequence[Scale],
    at: Callable[[Member, Scale], Member],
    fail: Callable[[Sequence[Member]], Asking[list[bool]]],
) -> Asking[tuple[int, Member] | None]:
    """The first step of ``scale``, from the harmless to the harmful, at which one of ``members`` fails, and that member
    there; None if none fails at the last.

    The first member's step is found by bisection. Each other one is tried just below the smallest failing step so far,
    and only if it fails there, its own is found. That is exact where a member that fails at a step fails beyond it,
    too. ``at(member, step)`` changes a member, ``fail(members)`` asks which of them fail.
    """
    best: tuple[int, Member] | None = None
    for first in (0, *range(1, len(members), BATCH)):
        high = (len(scale) if best is None else best[0]) - 1
        low = -1
        some = members[first : first + BATCH if first else 1] if high >= 0 else []
        failing = yield from _failing(some, scale, high, at, fail)
        while failing and high - low > 1:
            middle = (low + high) // 2
            now = yield from _failing(failing, scale, middle, at, fail)
            if now:
                high, failing = middle, now
            else:
                low = middle
        if failing:
            best = high, at(failing[0], scale[high])
    return best


def _failing(
    members: Sequence[Member],
    scale: Sequence[Scale],
    step: int,
    at: Callable[[Member, Scale], Member],
    fail: Callable[[Sequence[Member]], Asking[list[bool]]],
) -> Asking[list[Member]]:
    verdicts = yield from fail([at(member, scale[step]) for member in members])
    return [member for member, failed in zip(members, verdicts, strict=True) if failed]
