"""What can be done inside the sandbox that must not: each is tried there, before anything is certified."""

from __future__ import annotations

import ctypes
import errno
import functools
import os
import platform
import socket
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import suppress
from pathlib import Path

from ..cache import PACKAGE
from .launch import boot, environment
from .sandbox import TMPFS_BYTES, WORK, command
from .sandbox import environment as kept
from .seccomp import FIRST_NEW, MACHINES, REFUSED, TALK, deny_covert_channels

NEW_USER = 0x10000000
"""CLONE_NEWUSER of linux/sched.h."""

PIECE_BYTES = 1 << 24


def leaks() -> tuple[str, ...]:
    """What of the forbidden works inside a sandbox; all should be refused.

    Raises :class:`~orchestrator.errors.InputError` where there is no sandbox.
    """
    os.environ[SECRET] = "1"
    with socket.create_server(("127.0.0.1", 0)) as server, tempfile.NamedTemporaryFile() as hidden:
        told = (server.getsockname()[1], os.getpid(), hidden.name, _file_of_the_home() or hidden.name)
        words = [*command((), alone=True), *boot("sandbox_probe", *told)]
        try:
            tried = subprocess.run(
                words, capture_output=True, text=True, check=False, env=kept(environment()), stdin=subprocess.DEVNULL
            )
        finally:
            del os.environ[SECRET]
    if tried.returncode != 0:
        return (f"the probe itself: {tried.stderr.strip()[-200:]}",)
    return tuple(tried.stdout.splitlines())


def _file_of_the_home() -> str:
    """A real file of the user's home, empty if there is none: that one file can be read shows that all can."""
    # The home of a service's user is often a folder that is not there.
    with suppress(OSError, RuntimeError), os.scandir(Path.home()) as entries:
        return next((entry.path for entry in entries if entry.is_file()), "")
    return ""


SECRET = "FLEXIBLE_MANIPULATOR_SECRET"
"""Of the environment outside; it must not be seen inside."""


FILE = sys.executable
"""One that all sandboxes show."""

VIRTUAL = 40
"""AF_VSOCK of linux/socket.h."""

GET_KEYRING, SESSION = 0, -3
"""KEYCTL_GET_KEYRING_ID, KEY_SPEC_SESSION_KEYRING of linux/keyctl.h."""


def main(port: int, outside: int, hidden: str, private: str) -> None:
    """Inside: try everything, and print what works."""
    _try({"the network": lambda: socket.create_connection(("127.0.0.1", port), 1.0)})  # the filter refuses it as well
    deny_covert_channels()
    tries: dict[str, Callable[[], object]] = {
        "writing into the package": lambda: (PACKAGE / "probe").write_bytes(b""),
        "writing into the home folder": lambda: (Path.home() / ".flexible-manipulator-probe").write_bytes(b""),
        "reading temporary files of others": lambda: Path(hidden).read_bytes(),
        "the processes of others": lambda: _require(Path(f"/proc/{outside}/cmdline").read_bytes() != b"" and _many()),
        "the environment of others": lambda: os.environ[SECRET],
        "a user namespace of its own": _user_namespace,
        "more memory than allowed in temporary files": lambda: _fill(Path(WORK)),
        "more memory than allowed in shared memory": lambda: _fill(Path("/dev/shm")),
        "writing into /dev": lambda: Path("/dev/probe").write_bytes(b""),
        "marking a device": lambda: os.utime("/dev/null", (1, 1)),
        "reading files of the home folder": lambda: Path(private).read_bytes(),
        "the keyring of the session": lambda: _require(_keyring() >= 0),
        "sockets of virtual machines": lambda: socket.socket(VIRTUAL, socket.SOCK_STREAM),
        "locking files of the machine": lambda: _locked(FILE),
        "watching files of the machine": lambda: _require(ctypes.CDLL(None).inotify_init() >= 0),
        "whether files of the machine lie in memory": lambda: _forget(FILE),
        "what the kernel shows in /proc": lambda: _require(bool(os.listdir("/proc"))),
        "what the kernel shows in /sys": lambda: _require(bool(os.listdir("/sys"))),
        "terminals, which the machine counts": lambda: os.open("/dev/ptmx", os.O_RDWR),
        "pipes, which the machine counts": os.pipe,
        "sockets, which the machine counts": lambda: socket.socket(socket.AF_UNIX),
        "memory of the machine": lambda: _require(_answer("sysinfo", ctypes.create_string_buffer(256)) == 0),
        "free space on the machine's disks": lambda: os.statvfs(FILE),
        "page faults, which tell what lies in memory": _page_faults,
        **{f"the system call {name}": functools.partial(_works, name) for name in {**REFUSED, **TALK}},
        "system calls that are newer than the list": lambda: _require(_errno(FIRST_NEW + 13) != errno.ENOSYS),
    }
    _try(tries)


def _try(tries: Mapping[str, Callable[[], object]]) -> None:
    for name, attempt in tries.items():
        with suppress(OSError, KeyError):
            attempt()
            print(name, flush=True)


def _require(condition: bool) -> None:
    if not condition:
        raise OSError


def _page_faults() -> None:
    import resource  # not on Windows

    resource.getrusage(resource.RUSAGE_SELF)


def _answer(name: str, *words: object) -> int:
    return int(getattr(ctypes.CDLL(None), name)(*words))


def _errno(number: int) -> int:
    """What the call says to arguments that none can take."""
    libc = ctypes.CDLL(None, use_errno=True)
    return ctypes.get_errno() if libc.syscall(ctypes.c_long(number), *[ctypes.c_long(-1)] * 6) == -1 else 0


def _works(name: str) -> None:
    """Raise :class:`OSError` if the call ``name`` is refused before its arguments are looked at, or is not there."""
    numbers, machine = {**REFUSED, **TALK}[name], MACHINES.get(platform.machine())
    number = None if machine is None else numbers[machine[1]]
    _require(number is not None and _errno(number) not in (errno.EPERM, errno.ENOSYS))


def _many() -> bool:
    """Whether processes beside the sandbox's own are seen: its first one, and this one."""
    return sum(name.isdigit() for name in os.listdir("/proc")) > 3


def _user_namespace() -> None:
    child = os.fork()
    if child == 0:
        os._exit(0 if ctypes.CDLL(None, use_errno=True).unshare(NEW_USER) == 0 else 1)
    _, status = os.waitpid(child, 0)
    _require(status == 0)


def _keyring() -> int:
    number = {"x86_64": 250, "aarch64": 219}.get(platform.machine())
    return -1 if number is None else int(ctypes.CDLL(None).syscall(number, GET_KEYRING, SESSION, 0))


def _locked(name: str) -> None:
    import fcntl  # not on Windows

    with open(name, "rb") as file:
        fcntl.flock(file, fcntl.LOCK_SH | fcntl.LOCK_NB)


def _forget(name: str) -> None:
    with open(name, "rb") as file:
        os.posix_fadvise(file.fileno(), 0, 0, os.POSIX_FADV_DONTNEED)


def _fill(folder: Path) -> None:
    """Write more into ``folder`` than it has room for."""
    place = folder / "probe"
    try:
        with place.open("wb", buffering=0) as file:
            for _ in range(TMPFS_BYTES // PIECE_BYTES + 1):
                _require(file.write(bytes(PIECE_BYTES)) == PIECE_BYTES)
    finally:
        with suppress(OSError):
            place.unlink()
