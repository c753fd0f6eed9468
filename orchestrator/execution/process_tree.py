"""A process and all that it has started: how much memory they use, and how all of them are ended."""

from __future__ import annotations

import ctypes
import os
import signal
import sys
from contextlib import suppress
from pathlib import Path

import psutil

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


class ProcessTree:
    """The process ``pid`` and its descendants, as far as they have been seen.

    A process that leaves the group and the session of its parent still counts if it was seen while its parent lived.
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

    def is_stopped(self) -> bool:
        """Whether the first of them is stopped, as by SIGSTOP or a frozen container."""
        return self._status() in (psutil.STATUS_STOPPED, psutil.STATUS_TRACING_STOP)

    def is_alive(self) -> bool:
        """Whether the first of them has not ended."""
        return self._status() not in ("", psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)

    def _status(self) -> str:
        with suppress(psutil.Error, KeyError):
            return str(self._members[self._pid].status())
        return ""

    def kill(self) -> None:
        """End all of them. psutil makes sure that each is still the process it was."""
        with suppress(psutil.Error, KeyError):
            self._members[self._pid].suspend()  # so that it starts no more while we count
        self._look()
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(self._pid, signal.SIGKILL)
        for member in self._members.values():
            with suppress(psutil.Error):
                member.kill()

    def _look(self) -> None:
        waiting, seen = list(self._members), set(self._members)
        while waiting:
            new = set(children(waiting.pop())) - seen
            seen |= new
            waiting += new
            for pid in new:
                self._meet(pid)

    def _meet(self, pid: int) -> None:
        if pid not in self._members:
            with suppress(psutil.Error):
                self._members[pid] = psutil.Process(pid)


FOREIGN_SIGNALS = ("SIGKILL", "SIGTERM", "SIGHUP", "SIGQUIT")
"""With which others end a process, such as a system that is out of memory."""


def end_of(exit_code: int, sandboxed: bool) -> tuple[str, str]:
    """How a process ended, in words, and the name of the signal if one ended it."""
    number = exit_code - 128 if sandboxed and exit_code > 128 else -exit_code  # a sandbox passes signals on like this
    if number <= 0:
        return f"process ended by itself with exit code {exit_code}", ""
    known = {each.value: each.name for each in signal.Signals}
    name = known.get(number, f"signal {number}")
    return f"process was ended by {name}", name


def bind_to_parent(parent: int) -> None:
    """End with ``parent``, at once if that is not this process's parent any more (Linux), and adopt orphans."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(1)
    adopt_orphans()


def adopt_orphans() -> None:
    """Linux: this process becomes the parent of those of its descendants whose own parent ends."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_CHILD_SUBREAPER, 1)


def children(pid: int) -> list[int]:
    """The processes whose parent is ``pid``."""
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
