"""Time limits that do not depend on what else the machine does.

A limit counts the processor time of a process and of all that it has started. A process that waits, for a lock, a
socket or a clock, uses none: how long it waits is limited as well, and is counted only while it uses next to no
processor time and is not ready to.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from .process_tree import Use

WAITING_FACTOR = 2.0
"""Limit of waiting, in time limits."""

IDLE_SHARE = 0.05
"""Time per second, with a processor or ready for one, below which a process waits: one that sleeps between short calls
does, too."""

MAX_INTERVAL = 1.0
"""Seconds that count at most between two looks: whoever looks may have been suspended, and the process with it."""

POLL_INTERVAL = 0.1
"""Seconds between two looks at a process that should end."""

PROCESSOR_REACHED, WAITING_REACHED = "the limit of processor time was reached", "the limit of waiting was reached"


class Tree(Protocol):
    """What uses processor time."""

    def use(self) -> Use:
        """What it has used so far."""


@dataclass(frozen=True)
class Reading:
    """What a process has used at a ``time`` [s] of any steady clock."""

    time: float
    use: Use


@dataclass(frozen=True)
class TimeSpent:
    """Since some beginning: ``processor`` time [s], time ``waited`` [s], and whether it was ``stopped`` meanwhile."""

    processor: float = 0.0
    waited: float = 0.0
    stopped: bool = False

    def after(self, earlier: Reading, later: Reading) -> TimeSpent:
        """What is spent at the ``later`` look, if this is at the ``earlier`` one."""
        passed, used = later.time - earlier.time, max(later.use.processor - earlier.use.processor, 0.0)
        # Linux counts the time in the run queue; on a busy machine a process that waits for a processor is not idle.
        queued = max(later.use.queued - earlier.use.queued, 0.0)
        waits = not later.use.ready and used + queued < IDLE_SHARE * passed
        # A laptop that was closed for an hour must not end the case.
        waited = min(passed, MAX_INTERVAL) if waits else 0.0
        return TimeSpent(self.processor + used, self.waited + waited, self.stopped or later.use.stopped)

    def excess(self, limit: float) -> tuple[str, str]:
        """What has exceeded the time limit [s], in words with and without figures; empty if nothing has."""
        if self.processor > limit:
            return f"{PROCESSOR_REACHED}: {self.processor:.1f} s of {_seconds(limit)}", PROCESSOR_REACHED
        if self.waited > WAITING_FACTOR * limit:
            used = f"for {self.waited:.1f} s of {_seconds(WAITING_FACTOR * limit)} it was not seen to compute"
            return f"{WAITING_REACHED}: {used}, and it computed for {self.processor:.1f} s", WAITING_REACHED
        return "", ""


def _seconds(limit: float) -> str:
    return f"{limit:.1f}".removesuffix(".0") + " s"


class Stopwatch:
    """What a process tree spends from now on."""

    def __init__(self, tree: Tree) -> None:
        self._tree = tree
        self.begin()

    def begin(self) -> None:
        """Begin anew."""
        self._first = self._last = Reading(time.monotonic(), self._tree.use())
        self.spent = TimeSpent()

    @property
    def elapsed(self) -> float:
        """Wall time since the beginning [s]."""
        return time.monotonic() - self._first.time

    @property
    def age(self) -> float:
        """Wall time since the last look [s]."""
        return time.monotonic() - self._last.time

    def look(self) -> Use:
        """Bring ``spent`` up to date; what the tree uses."""
        now = Reading(time.monotonic(), self._tree.use())
        self.spent = self.spent.after(self._last, now)
        self._last = now
        return now.use


def end_within(patience: float, exit_code: Callable[[float], int | None], tree: Tree) -> int | None:
    """The exit code of a process that should end, or None if it goes on for ``patience`` [s], computing or waiting.

    ``exit_code`` waits for the end, for so many seconds at most.
    """
    watch, code = Stopwatch(tree), exit_code(0.0)
    while code is None and watch.spent.processor + watch.spent.waited < patience:
        code = exit_code(POLL_INTERVAL)
        watch.look()
    return code
