"""What two processes without a common file can both move and read: in the kernel's files outside, and in the sandbox.

Each mover below is tried twice. Outside, all files of /proc that belong to no process are read before and while it
holds what it has taken; those are printed in which a number changes clearly more than in idle readings. Inside, in the
sandbox of a verification, it is printed whether the mover is refused, and how many files of /proc and /sys there are.

    python benchmarks/shared_counters.py
"""

from __future__ import annotations

import ctypes
import inspect
import mmap
import os
import re
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from orchestrator.execution import sandbox  # noqa: E402
from orchestrator.execution.interpreter import program  # noqa: E402
from orchestrator.execution.seccomp import deny_covert_channels  # noqa: E402

COUNT = 200
"""How often a mover moves."""

LEFT_OUT = {"/proc/kmsg", "/proc/kcore", "/proc/kpagecount", "/proc/kpageflags", "/proc/kpagecgroup", "/proc/kallsyms"}
"""Files that wait, or are as large as the memory."""

NUMBER = re.compile(rb"\d+")

IDLE = 6
"""Readings while nothing is moved."""


def _names_in_vain() -> None:
    for number in range(100 * COUNT):
        os.path.exists(f"/usr/nothing-{os.getpid()}-{number}")


def _open_files() -> list[int]:
    return [os.open(os.devnull, os.O_RDONLY) for _ in range(COUNT)]


def _pipes() -> list[tuple[int, int]]:
    return [os.pipe() for _ in range(COUNT)]


def _terminals() -> list[int]:
    return [os.open("/dev/ptmx", os.O_RDWR | os.O_NOCTTY) for _ in range(20)]


def _sockets() -> list[tuple[socket.socket, socket.socket]]:
    return [socket.socketpair() for _ in range(COUNT)]


def _datagrams() -> socket.socket:
    receiver, sender = (socket.socket(socket.AF_INET, socket.SOCK_DGRAM) for _ in "ab")
    receiver.bind(("127.0.0.1", 0))
    for _ in range(COUNT):
        sender.sendto(bytes(1000), receiver.getsockname())
    return receiver


def _memory() -> bytearray:
    return bytearray(os.urandom(1 << 16) * COUNT)


def _shared_memory() -> list[mmap.mmap]:
    return [mmap.mmap(-1, 1 << 16) for _ in range(COUNT)]


def _processes() -> None:
    for _ in range(COUNT):
        child = os.fork()
        if child == 0:
            os._exit(0)
        os.waitpid(child, 0)


def _call(name: str, *words: int) -> list[int]:
    """The descriptors that a function of the C library gives; raises :class:`OSError` where it is refused."""
    libc = ctypes.CDLL(None, use_errno=True)
    given = [int(getattr(libc, name)(*words)) for _ in range(20)]
    if min(given) < 0:
        raise OSError(ctypes.get_errno(), name)
    return given


def _watches() -> list[int]:
    return _call("inotify_init")


def _events() -> list[int]:
    return _call("eventfd", 0, 0)


def _epolls() -> list[int]:
    return _call("epoll_create", 1)


def _queues() -> list[int]:
    """Of System V: messages, which a namespace has for itself."""
    return _call("msgget", 0, 0o600)


def _asynchronous_reads() -> None:
    number = {"x86_64": 206, "aarch64": 0}[os.uname().machine]
    if ctypes.CDLL(None, use_errno=True).syscall(number, 100, ctypes.byref(ctypes.c_ulong())) != 0:
        raise OSError(ctypes.get_errno(), "io_setup")


MOVERS: dict[str, Callable[[], object]] = {
    name.strip("_").replace("_", " "): each
    for name, each in inspect.getmembers(sys.modules[__name__], inspect.isfunction)
    if name.startswith("_") and name != "_call"
}


def files(folder: str) -> Iterator[str]:
    """The files below ``folder`` that belong to no process."""
    for place, folders, names in os.walk(folder):
        folders[:] = [name for name in folders if place != "/proc" or not name.isdecimal()]
        yield from (path for name in names if (path := os.path.join(place, name)) not in LEFT_OUT)


def reading(listed: list[str]) -> dict[str, list[int]]:
    """The numbers in each file that can be read."""
    found = {}
    for path in listed:
        try:
            file = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
        except OSError:
            continue
        try:
            found[path] = [int(word) for word in NUMBER.findall(os.read(file, 1 << 16))]
        except OSError:
            pass
        finally:
            os.close(file)
    return found


def changes(first: dict[str, list[int]], second: dict[str, list[int]]) -> dict[str, list[int]]:
    """By how much each number of the files changed."""
    return {
        path: [abs(one - other) for one, other in zip(first[path], second[path], strict=True)]
        for path in first
        if len(first[path]) == len(second.get(path, ()))
    }


def outside() -> None:
    """Print in which files each mover changes a number that does not change as much by itself."""
    listed = list(files("/proc"))
    readings = [reading(listed) for _ in range(IDLE)]
    idle = [changes(one, other) for one, other in zip(readings, readings[1:], strict=False)]
    print(f"outside: {len(readings[0])} files of /proc can be read")
    for name, move in MOVERS.items():
        before = reading(listed)
        held = move()
        moved = changes(before, reading(listed))
        del held
        clear = [path for path, now in moved.items() if _is_clear(now, [each[path] for each in idle if path in each])]
        print(f"  {name}: {', '.join(clear) or 'none'}")


def _is_clear(now: list[int], idle: list[list[int]]) -> bool:
    """Whether a number changed by some, and by four times as much as ever in idle readings."""
    usual = [max(column) for column in zip(*(each for each in idle if len(each) == len(now)), strict=True)]
    return any(change > 5 + 4 * most for change, most in zip(now, usual, strict=False))


def inside() -> None:
    """Print what can be read, and what each mover may."""
    print(f"inside: {len([*files('/proc')])} files of /proc, {len([*files('/sys')])} of /sys")
    deny_covert_channels()
    for name, move in MOVERS.items():
        try:
            move()
        except OSError as problem:
            print(f"  {name}: refused ({problem.strerror})")
        else:
            print(f"  {name}: works")


if __name__ == "__main__":
    outside()
    sys.stdout.flush()
    words = [*sandbox.command((), alone=True), *program(f"from {Path(__file__).stem} import inside; inside()")]
    subprocess.run(words, env=sandbox.environment(os.environ), check=True)
