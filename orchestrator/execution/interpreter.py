"""The interpreter of processes of this package's own: clean, protected, and started with less.

A clean interpreter takes nothing from the environment, nor any byte-code or compiled code that exists. An FMU that has
run with the user's rights may have written such code for this package, which the hash of its sources does not show.

On Linux a process, with all that it starts, can see the package and the interpreter's libraries read-only, so that a
controller leaves no byte-code behind that a later run imports. It is in a mount namespace of its own then, and gives up
the capabilities with which it could change that. Nothing else is protected: what else the user may write, a controller
may (docs/running.md).
"""

from __future__ import annotations

import ctypes
import gc
import os
import signal
import site
import struct
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from ..cache import PACKAGE, VARIABLE, cache_folder

BYTE_CODE = "byte-code"
"""Folder in the cache for the byte-code of a clean interpreter."""


def is_clean() -> bool:
    """Whether this interpreter is one."""
    prefix = sys.pycache_prefix
    return bool(sys.flags.isolated) and prefix is not None and Path(prefix) == cache_folder() / BYTE_CODE


def flags() -> tuple[str, ...]:
    """The options with which a child is as clean as this one."""
    return ("-I", "-X", f"pycache_prefix={sys.pycache_prefix}") if is_clean() else ()


def program(code: str) -> list[str]:
    """The command that runs ``code`` in an interpreter as clean as this one, which has its search path.

    It has that before it imports anything: the current folder, which "-c" puts in front, may hold modules with the
    names of others.
    """
    paths = list(dict.fromkeys([*map(os.path.abspath, filter(None, sys.path)), str(PACKAGE.parent)]))
    return [sys.executable, *flags(), "-c", f"import sys; sys.path[:] = {paths!a}; {code}"]


def run_clean(code: str, arguments: Sequence[str], within: Path | None = None) -> int:
    """The exit code of ``code`` with the command line ``arguments`` in a clean interpreter with a new, empty cache,
    which is in the folder ``within``, or in that for temporary files."""
    cache = tempfile.TemporaryDirectory(prefix="flexible-manipulator-", dir=within, ignore_cleanup_errors=True)
    with cache as folder, _deaf():
        prefix = os.path.join(os.path.realpath(folder), BYTE_CODE)
        executable, *rest = program(code)
        # -I leaves out PYTHON* variables, the user's site-packages and the
        # current folder, each of which an FMU may have prepared.
        command = [executable, "-I", "-X", f"pycache_prefix={prefix}", *rest, *arguments]
        variables = {**os.environ, VARIABLE: os.path.realpath(folder)}
        return subprocess.run(command, env=variables, check=False).returncode


@contextmanager
def _deaf() -> Iterator[None]:
    """Ctrl-C reaches the child as well, and is its to handle."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


PACKAGES = ("orchestrator", "plant_fmu", "controller_fmu")
"""The project's packages, which lie side by side."""

NEW_USER, NEW_MOUNTS = 0x10000000, 0x00020000
"""CLONE_NEWUSER, CLONE_NEWNS of unshare(2)."""

READ_ONLY, REMOUNT, BIND, RECURSIVE, SLAVE, RELATIVE = 1, 32, 4096, 16384, 1 << 19, 1 << 21
"""MS_RDONLY, MS_REMOUNT, MS_BIND, MS_REC, MS_SLAVE, MS_RELATIME of mount(2)."""

KEPT = os.ST_NOSUID | os.ST_NODEV | os.ST_NOEXEC | os.ST_NOATIME | os.ST_NODIRATIME if sys.platform == "linux" else 0
"""Flags of a mount that one without capabilities outside may not take away; as numbers, those of mount(2)."""

DROP_BOUND, NO_NEW_PRIVILEGES = 24, 38
"""PR_CAPBSET_DROP, PR_SET_NO_NEW_PRIVS of prctl(2)."""

CAPABILITIES = 64
"""More than there are."""

CAPSET_VERSION = 0x20080522
"""_LINUX_CAPABILITY_VERSION_3."""


def read_only_folders() -> tuple[str, ...]:
    """What is to be read-only: real paths of folders that exist, none inside another."""
    libraries = (sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib", "scripts"))
    packages = (str(PACKAGE.parent / name) for name in PACKAGES)
    given = filter(None, (*packages, *libraries, site.getusersitepackages(), sys.pycache_prefix))
    paths = {Path(os.path.realpath(path)) for path in given if os.path.isdir(path)}
    return tuple(sorted(str(path) for path in paths if paths.isdisjoint(path.parents)))


def protect() -> bool:
    """Make these folders read-only for this process and all that it will start; False where that cannot be done.

    The process has one thread. It is tried in a copy of the process first: half of it would be worse than nothing.
    """
    if sys.platform != "linux":
        return False
    chosen = read_only_folders()
    pid = os.fork()
    if pid == 0:
        done = False
        with suppress(OSError):
            _protect(chosen)
            done = not any(os.access(folder, os.W_OK) for folder in chosen)
        os._exit(0 if done else 1)
    if os.waitpid(pid, 0)[1] != 0:
        return False
    _protect(chosen)
    return True


def _protect(chosen: Iterable[str]) -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    uid, gid = os.getuid(), os.getgid()
    _call(libc.unshare(NEW_USER | NEW_MOUNTS))
    # user_namespaces(7): without "deny" a process without rights may not write gid_map.
    for name, words in (("setgroups", "deny"), ("uid_map", f"{uid} {uid} 1"), ("gid_map", f"{gid} {gid} 1")):
        Path("/proc/self", name).write_text(words)
    # Slave: what is mounted outside later still appears here, and nothing of here outside.
    _call(libc.mount(None, b"/", None, ctypes.c_ulong(RECURSIVE | SLAVE), None))
    for folder in chosen:
        path, kept = folder.encode(), os.statvfs(folder).f_flag
        # A remount that drops nosuid, nodev or noexec of a mount from outside is refused in a user namespace.
        flags = kept & KEPT | (RELATIVE if kept & os.ST_RELATIME else 0)
        _call(libc.mount(path, path, None, ctypes.c_ulong(BIND | RECURSIVE), None))
        _call(libc.mount(None, path, None, ctypes.c_ulong(REMOUNT | BIND | READ_ONLY | flags), None))
    for capability in range(CAPABILITIES):
        libc.prctl(DROP_BOUND, capability, 0, 0, 0)  # it fails for those that there are not
    # Else a program with setuid, such as sudo or fusermount, would give the capabilities back.
    _call(libc.prctl(NO_NEW_PRIVILEGES, 1, 0, 0, 0))
    _call(libc.capset(struct.pack("II", CAPSET_VERSION, 0), bytes(24)))  # none effective, permitted or inheritable


def _call(result: int) -> None:
    if result != 0:
        raise OSError(ctypes.get_errno(), os.strerror(ctypes.get_errno()))


UNNEEDED = ("scipy", "coverage", "yaml")
"""What Numba would load and compiled code of this package does not need; SciPy takes half of the time to start."""


@contextmanager
def lean_imports() -> Iterator[None]:
    """Within, modules that are not needed cannot be imported, and no garbage is looked for: what importing makes stays,
    and is left out of later looks, too.

    Not for the user's process, whose other threads may import what they like.
    """
    hidden = [name for name in UNNEEDED if name not in sys.modules]
    # Numba looks for SciPy to support scipy.linalg in compiled code, and goes on without it.
    sys.modules.update(dict.fromkeys(hidden))  # type: ignore[arg-type]  # None forbids
    gc.disable()
    try:
        yield
    finally:
        # The collector writes into every object that it looks at, and a forked worker would copy all these pages.
        gc.freeze()
        gc.enable()
        for name in hidden:
            del sys.modules[name]  # an FMU may want it
