"""A process and all that it has started: how much memory they use, and how all of them are ended."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import psutil

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


class Family:
    """The process ``pid`` and its descendants, as far as they have been seen.

    Who leaves the group and the session of its parent stays one of the family if it was seen while its parent lived.
    """

    def __init__(self, pid: int) -> None:
        self._pid, self._members = pid, dict[int, psutil.Process]()
        self._meet(pid)

    def memory(self) -> int:
        """Resident memory [bytes] of those alive; also looks for new members."""
        self._look()
        used = 0
        for member in self._members.values():
            with suppress(psutil.Error):
                used += member.memory_info().rss
        return used

    def kill(self) -> None:
        """End all of them. psutil makes sure that each is still the process it was."""
        if self._pid in self._members:
            with suppress(psutil.Error):
                self._members[self._pid].suspend()  # it shall start no more while we count
        self._look()
        if os.name == "posix":
            with suppress(ProcessLookupError, PermissionError):
                os.killpg(self._pid, signal.SIGKILL)
        for member in self._members.values():
            with suppress(psutil.Error):
                member.kill()

    def _look(self) -> None:
        for pid in list(self._members):
            for descendant in _descendants(pid):
                self._meet(descendant)

    def _meet(self, pid: int) -> None:
        if pid not in self._members:
            with suppress(psutil.Error):
                self._members[pid] = psutil.Process(pid)


def bind_to_parent() -> None:
    """Linux: this process ends with its parent, and inherits the orphans among its descendants."""
    if sys.platform == "linux":
        prctl = ctypes.CDLL(None).prctl
        prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
        prctl(_PR_SET_CHILD_SUBREAPER, 1)


def _descendants(pid: int) -> Iterator[int]:
    """Children, their children, and so on."""
    for child in _children(pid):
        yield child
        yield from _descendants(child)


def _children(pid: int) -> list[int]:
    # psutil reads the entries of all processes of the machine, which takes too long where there are many.
    tasks = Path("/proc", str(pid), "task")
    try:
        return [int(word) for task in tasks.iterdir() for word in (task / "children").read_text().split()]
    except OSError:
        pass
    if tasks.parent.parent.joinpath("self", "task").is_dir():
        return []  # the process is gone
    with suppress(psutil.Error):
        return [child.pid for child in psutil.Process(pid).children()]
    return []
