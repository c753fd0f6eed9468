"""A clean interpreter: one that takes nothing from the environment, nor any byte-code or compiled code that exists.

An FMU that has run with the user's rights may have written such code for this package, which the hash of its sources
does not show.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
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


def run_clean(code: str, arguments: Sequence[str]) -> int:
    """The exit code of ``code`` with the command line ``arguments`` in a clean interpreter with a new, empty cache."""
    with tempfile.TemporaryDirectory(prefix="flexible-manipulator-", ignore_cleanup_errors=True) as folder, _deaf():
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
