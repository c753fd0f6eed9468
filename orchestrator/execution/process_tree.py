"""A process and all that it has started: what they use, and how all of them are ended."""

from __future__ import annotations

import ctypes
import os
import signal
import subprocess
import sys
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

import psutil

_PR_SET_PDEATHSIG, _PR_SET_CHILD_SUBREAPER = 1, 36


@dataclass(frozen=True)
class Use:
    """What a process tree has used so far, and what it is doing.

    ``processor`` [s] is the processor time of all its processes, as far as they have been seen; ``queued`` [s] the time
    that threads of those alive were ready to run but had no processor, 0 where the system does not tell; ``memory``
    [bytes] the resident memory of those alive. ``ready`` tells whether one of their threads runs or waits for a
    processor; one that sleeps, or waits for a lock, a file or a socket does not. ``stopped`` tells whether the first
    process is stopped, as by SIGSTOP or a debugger. ``processes`` is the number of those alive, ``threads`` that of all
    their threads.
    """

    processor: float
    queued: float
    memory: int
    ready: bool
    stopped: bool
    processes: int = 1
    threads: int = 1


@dataclass(frozen=True)
class _Member:
    """One process: its own processor time and that of the children it has waited for [s], see :class:`Use`."""

    processor: float
    children: float
    queued: float
    memory: int
    ready: bool
    stopped: bool
    threads: int


class ProcessTree:
    """The process ``pid`` and its descendants, as far as they have been seen.

    A process that leaves the group and the session of its parent still counts if it was seen while its parent lived.
    """

    def __init__(self, pid: int) -> None:
        self._pid, self._members = pid, dict[int, psutil.Process]()
        self._processor, self._most = dict[int, float](), 0.0
        self._meet(pid)

    def use(self) -> Use:
        """What it uses; also looks for new members."""
        self._look()
        members = {pid: read for pid, member in self._members.items() if (read := _read(member)) is not None}
        self._processor.update((pid, read.processor) for pid, read in members.items())
        # The system adds the time of a child to that of its parent, unless the parent ignores how its children end:
        # such a child counts as far as it was seen. Neither sum is more than what was used.
        seen, waited_for = (
            sum(self._processor.values()),
            sum(read.processor + read.children for read in members.values()),
        )
        self._most = max(self._most, seen, waited_for)
        return Use(
            processor=self._most,
            queued=sum(read.queued for read in members.values()),
            memory=sum(read.memory for read in members.values()),
            ready=any(read.ready for read in members.values()),
            stopped=self._pid in members and members[self._pid].stopped,
            processes=len(members),
            threads=sum(read.threads for read in members.values()),
        )

    def is_alive(self) -> bool:
        """Whether the first of them has not ended."""
        with suppress(psutil.Error, KeyError):
            return self._members[self._pid].status() not in (psutil.STATUS_ZOMBIE, psutil.STATUS_DEAD)
        return False

    def kill(self) -> None:
        """End all of them. psutil makes sure that each is still the process it was."""
        with suppress(psutil.Error, KeyError):
            self._members[self._pid].suspend()  # so that it starts no more while we count
        self._look()
        with suppress(ProcessLookupError, PermissionError):
            # The group also has those that were started after the last look.
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


_STATE, _TIMES, _RESIDENT = 0, slice(11, 15), 21
"""Fields of /proc/PID/stat (proc(5)) behind the name: state; utime, stime, cutime, cstime; rss."""


def _read(member: psutil.Process) -> _Member | None:
    """What the system says of a process; None if it is gone."""
    if sys.platform != "linux":
        return _read_portably(member)
    place = Path("/proc", str(member.pid))
    fields = _fields(place)
    if not fields or not member.is_running():  # another process may have its number by now
        return None
    threads = _threads(place)
    # By thread: an FMU may compute in one while its first one sleeps.
    states = {thread[_STATE] for thread in map(_fields, threads) if thread}
    tick, page = os.sysconf("SC_CLK_TCK"), os.sysconf("SC_PAGE_SIZE")
    user, system, *waited_for = (int(field) / tick for field in fields[_TIMES])
    memory = int(fields[_RESIDENT]) * page
    queued = sum(map(_queued, threads))
    ready, stopped = "R" in states, bool(states & {"T", "t"})
    return _Member(user + system, sum(waited_for), queued, memory, ready, stopped, len(threads))


def _threads(place: Path) -> list[Path]:
    with suppress(OSError):
        return list((place / "task").iterdir())
    return []


def _queued(thread: Path) -> float:
    """Time [s] that a thread was ready to run without a processor; 0 if it is gone, or the system does not tell."""
    with suppress(OSError, IndexError, ValueError):
        return int((thread / "schedstat").read_text().split()[1]) * 1e-9
    return 0.0


def _fields(place: Path) -> list[str]:
    """Of a process or a thread, nothing if it is gone; its name, which may hold anything, is left out."""
    with suppress(OSError):
        return (place / "stat").read_text(errors="replace").rpartition(")")[2].split()
    return []


def _read_portably(member: psutil.Process) -> _Member | None:
    try:
        times, memory, status = member.cpu_times(), member.memory_info().rss, member.status()
        threads = member.num_threads()
    except psutil.Error:
        return None
    waited_for = getattr(times, "children_user", 0.0) + getattr(times, "children_system", 0.0)
    ready, stopped = status == psutil.STATUS_RUNNING, status == psutil.STATUS_STOPPED
    return _Member(times.user + times.system, waited_for, 0.0, memory, ready, stopped, threads)


FOREIGN_SIGNALS = ("SIGKILL", "SIGTERM", "SIGHUP", "SIGQUIT")
"""With which others end a process, such as a system that is out of memory."""


def end_of(exit_code: int, sandboxed: bool) -> tuple[str, str]:
    """How a process ended, in words, and the name of the signal if one ended it."""
    number = exit_code - 128 if sandboxed and exit_code > 128 else -exit_code  # a sandbox passes signals on like this
    if number <= 0:
        return f"process ended by itself with exit code {exit_code}", ""
    names = {item.value: item.name for item in signal.Signals}
    name = names.get(number, f"signal {number}")
    return f"process was ended by {name}", name


def exit_code(process: subprocess.Popen[bytes], patience: float) -> int | None:
    """The exit code of ``process``, negative for a signal; None if it is alive after ``patience`` [s]."""
    with suppress(subprocess.TimeoutExpired):
        process.wait(patience)
    return process.returncode


def bind_to_parent(parent: int) -> None:
    """End with ``parent``, at once if that is not this process's parent any more (Linux), and adopt orphans."""
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(_PR_SET_PDEATHSIG, signal.SIGKILL)
    # The parent may have ended before prctl, which then waits for nothing.
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
