"""Simulations that stand still: told while they do, and ended before the limit of a long one."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..fmi.trace import Place
from .time_limit import PROCESSOR_REACHED, WAITING_FACTOR, WAITING_REACHED, TimeSpent

STANDSTILL_TIME = 10.0
"""Seconds at one place after which a simulation stands still: a whole one of 26 s computes for a second or two, so that
a machine must be very busy before one that goes on is taken for one that does not."""


@dataclass(frozen=True)
class Standstill:
    """The simulation of a task has been at ``place`` for ``seconds``; if it goes on like that, it is ended in
    ``remaining`` [s], when the ``limit`` was reached. ``remaining`` is infinite while it gets no processor."""

    place: Place
    seconds: float
    remaining: float
    limit: str


@dataclass(frozen=True)
class Lookout:
    """Where a task was at the last look: the ``place``, ``since`` when [s], and what it had ``spent`` before; whether
    its standstill there is ``told``."""

    task: int = -1
    place: Place | None = None
    since: float = 0.0
    spent: TimeSpent = TimeSpent()
    told: bool = False

    def after(self, task: int, place: Place, time: float, spent: TimeSpent) -> Lookout:
        """The same after a look at the ``time`` [s]."""
        # The sample counts in the place, so a slow controller moves, and only one that hangs does not.
        if (task, place) == (self.task, self.place):
            return self
        return Lookout(task, place, time, spent)

    def here(self, spent: TimeSpent) -> TimeSpent:
        """What of ``spent`` was spent at the place."""
        return TimeSpent(spent.processor - self.spent.processor, spent.waited - self.spent.waited)

    def standstill(self, time: float, spent: TimeSpent, limit: float, longest: float) -> Standstill | None:
        """What is to be told at the ``time`` [s] of a task that has ``spent`` so much of its time ``limit`` [s], and
        may spend the ``longest`` time [s] at a place; None if nothing is."""
        seconds, here = time - self.since, self.here(spent)
        if self.told or self.place is None or seconds < STANDSTILL_TIME:
            return None
        left = min(limit - spent.processor, longest - here.processor)
        wait = WAITING_FACTOR * min(limit - spent.waited / WAITING_FACTOR, longest - here.waited / WAITING_FACTOR)
        ends = ((left, here.processor, PROCESSOR_REACHED), (wait, here.waited, WAITING_REACHED))
        remaining, reached = min((_until(*end[:2], seconds), end[2]) for end in ends)
        return Standstill(self.place, seconds, remaining, reached)

    def silent(self) -> Lookout:
        """The same, told."""
        return replace(self, told=True)


def _until(left: float, used: float, seconds: float) -> float:
    """Seconds until what is ``left`` is used up, of which so much was ``used`` in the last ``seconds``."""
    return max(left, 0.0) * seconds / used if used > 0.0 else math.inf
