"""The sandbox of a child process: what bubblewrap leaves of the machine. docs/running.md says it for users."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from ..cache import DEVICES, PACKAGE, PRIVATE, VARIABLE, cache_folder, compiled_code_folder, user_folders
from ..errors import InputError
from .interpreter import PACKAGES, flags

TMPFS_BYTES = 256 * 1024**2
"""Bytes that fit into each folder that can be written into: it lies in memory."""

OPTIONS = (
    *("--unshare-all", "--die-with-parent", "--new-session", "--cap-drop", "ALL"),
    *("--ro-bind", "/", "/"),
)
"""No network, no other processes, everything read-only. Root would keep its capabilities, with which it can mount
everything writable again."""

SHARED_MEMORY = ("--size", str(TMPFS_BYTES), "--tmpfs", "/dev/shm", "--remount-ro", "/dev")

SYSTEM = ("--dev", "/dev", *SHARED_MEMORY, "--proc", "/proc", "--remount-ro", "/proc")
"""Root needs no capability to write into /proc/sys, which is the whole machine's."""

ALONE = ("--tmpfs", "/dev", *(word for name in DEVICES for word in ("--dev-bind", name, name)), *SHARED_MEMORY)
"""A controller alone has no terminals, of which the machine has a number."""

NO_PROC = ("--tmpfs", "/proc", "--remount-ro", "/proc")
"""Nor has it /proc: files there show counters of the whole machine, which a controller can move, and each that is
looked up moves another counter."""

NO_USER_NAMESPACES = ("--unshare-user", "--disable-userns")
"""Inside, nobody becomes root in a namespace of its own, from which much of the kernel can be reached. Bubblewrap has
this from 0.8 on."""

HIDDEN = ("/tmp", "/var/tmp", "/run")
"""Empty inside, beside the folder for temporary files and the cache: other programs' sockets, which a read-only file
system does not keep anybody from connecting to, and scratch files."""

HANDED_ON = (VARIABLE, "PATH", "HOME", "LANG", "LANGUAGE", "TZ", "LD_LIBRARY_PATH")
HANDED_ON_BEGINNINGS = ("LC_", "PYTHON", "NUMBA_", "OMP_", "OPENBLAS_", "MKL_")
"""Of the environment: where things are, and what numbers may depend on. Passwords and tokens stay outside."""

BUILDERS = "build_fmus.py"
"""The module beside the packages."""

WORK = "/tmp/.flexible-manipulator"
"""The working folder inside: new and empty. The folder for temporary files is not empty if Python or this package lies
below it."""

GIVEN = ".given"
"""Folder in the inner cache with what is copied into that at the start. The copy lies in memory and goes with the
sandbox, however that or its owner ends."""


def command(fmus: Iterable[Path], alone: bool = False, talking: bool = False) -> list[str]:
    """The words before a command that let it run in a sandbox with the extracted ``fmus``; one of a controller
    ``alone`` shows none of the user's files, and nothing in which the kernel says how it is, but the processes inside
    if some are ``talking`` with each other (:func:`.seccomp.deny_covert_channels`).

    Raises :class:`InputError` where there is no sandbox on this machine.
    """
    program = shutil.which("bwrap")
    if program is None:
        raise InputError("A sandbox needs bubblewrap (bwrap), which is not installed.", "no-sandbox")
    cache = cache_folder()
    system = (*ALONE, *(_processes_only() if talking else NO_PROC)) if alone else SYSTEM
    rest = (*OPTIONS, *system, *_mounts(cache, alone), "--dir", WORK, "--chdir", WORK)
    try:
        start = (program, *NO_USER_NAMESPACES, *rest)
        _check(start)
    except InputError:
        start = (program, *rest)
        _check(start)
    return [*start, *_given(fmus, cache), "--"]


def _processes_only() -> tuple[str, ...]:
    """Options that show of /proc what belongs to processes alone, and the links to that."""
    with os.scandir("/proc") as entries:
        others = [entry for entry in entries if not entry.name.isdecimal() and not entry.is_symlink()]
    empty = {entry.path: ("--tmpfs",) if entry.is_dir() else ("--ro-bind", os.devnull) for entry in others}
    return "--proc", "/proc", *(word for path in sorted(empty) for word in (*empty[path], path)), *NO_PROC[2:]


def environment(outside: Mapping[str, str]) -> dict[str, str]:
    """What of the environment ``outside`` is kept inside."""
    kept = {k: v for k, v in outside.items() if k in HANDED_ON or k.startswith(HANDED_ON_BEGINNINGS)}
    return {**kept, "TMPDIR": "/tmp"}


def given_folder() -> Path:
    """Inside: the folder with what is to be copied into the cache."""
    return cache_folder() / GIVEN


def _mounts(cache: Path, alone: bool) -> tuple[str, ...]:
    """Options that hide folders, and show again what of their contents Python needs: an environment may lie there."""
    writable = {os.path.realpath(path) for path in (*HIDDEN, tempfile.gettempdir(), cache) if os.path.isdir(path)}
    needed = [sys.prefix, sys.base_prefix, *filter(None, (sys.pycache_prefix,)), *_search_path(alone)]
    private = {os.path.realpath(path) for path in (os.environ.get(PRIVATE, ""),) if os.path.isdir(path)}
    hidden = writable | private | (_rest(needed) if alone else set())
    mounts: dict[str, tuple[str, ...]] = {path: ("--size", str(TMPFS_BYTES), "--tmpfs", path) for path in hidden}
    # Both spellings: a virtual environment may be reached through a link that is hidden itself.
    for path in (plain(name) for plain in (os.path.abspath, os.path.realpath) for name in needed):
        if path not in hidden and _is_below(path, hidden) and os.path.exists(path):
            mounts[path] = ("--ro-bind", path, path)
    if str(cache) not in hidden and _is_below(str(cache), hidden):
        mounts[str(cache)] = ("--symlink", os.path.realpath(cache), str(cache))
    # A folder before what lies in it: a later mount hides what is already there.
    made = (word for path in sorted(mounts) for word in mounts[path])
    return (*made, *(word for path in sorted(hidden - writable) for word in ("--remount-ro", path)))


def _search_path(alone: bool) -> tuple[str, ...]:
    """Where modules are found; alone, of the folder around this package and of the current one only the packages."""
    around = str(PACKAGE.parent)
    if not alone:
        return (*sys.path, around)
    libraries = filter(None, os.environ.get("LD_LIBRARY_PATH", "").split(os.pathsep))
    # pip may have installed this package into site-packages, which a controller needs as its libraries.
    left_out = {around, os.getcwd()} - {sysconfig.get_path(name) for name in ("purelib", "platlib")}
    others = [path for path in sys.path if path and not any(_is_below(folder, (path,)) for folder in left_out)]
    return (*others, *libraries, *(os.path.join(around, name) for name in (*PACKAGES, BUILDERS)))


def _rest(needed: Iterable[str]) -> set[str]:
    """What a controller alone does not see: all folders but the system's, and the one around this package.

    One of the user's files is the certificate that is repeated, or the round of a beacon: with it a controller could
    compute its draws.
    """
    around = os.path.realpath(PACKAGE.parent)
    return user_folders() | (set() if _is_below(around, map(os.path.realpath, needed)) else {around})


def _is_below(path: str, folders: Iterable[str]) -> bool:
    return any(Path(path).is_relative_to(folder) for folder in folders)


def _given(fmus: Iterable[Path], cache: Path) -> list[str]:
    """Options that show compiled code and the FMUs, and nothing else of the cache."""
    folders = (compiled_code_folder(), *fmus)
    inside = {folder: os.path.join(os.path.realpath(cache), GIVEN, folder.relative_to(cache)) for folder in folders}
    return [word for folder in inside if folder.is_dir() for word in ("--ro-bind", str(folder), inside[folder])]


def _check(start: tuple[str, ...]) -> None:
    """Raise :class:`InputError` where bubblewrap may not do its work, as where user namespaces are forbidden."""
    reason = _refusal(start)
    if reason:
        message = f"The sandbox does not work on this machine: {reason}. User namespaces must be allowed, and Python "
        message += f"and this package ({PACKAGE.parent}) must not lie directly in a folder that is hidden "
        message += f"({', '.join(HIDDEN)}). Without it FMUs run with your rights."
        raise InputError(message, "no-sandbox")


@functools.cache
def _refusal(start: tuple[str, ...]) -> str:
    """Why the command of a sandbox does not work; empty if it does."""
    code = f"import sys; sys.path.append({str(PACKAGE.parent)!r}); import orchestrator"
    options: dict[str, Any] = {"stdin": subprocess.DEVNULL, "capture_output": True, "env": environment(os.environ)}
    tried = subprocess.run([*start, "--", sys.executable, *flags(), "-c", code], text=True, check=False, **options)
    return "" if tried.returncode == 0 else tried.stderr.strip() or "bubblewrap failed"
