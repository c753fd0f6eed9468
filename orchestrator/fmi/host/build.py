"""Builds the host: ``python -m orchestrator.fmi.host.build`` makes ``host.exe`` anew, with the package ``ziglang``."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

SOURCE = Path(__file__).with_name("host.c")

WINDOWS = (sys.executable, "-m", "ziglang", "cc", "-target", "x86_64-windows-gnu")
"""The compiler that makes ``host.exe``: it brings its own C library, so the bytes are the same on every machine."""

FLAGS = ("-std=gnu99", "-O2", "-s", "-Wall", "-Wextra", "-Werror")


def build(program: Path, compiler: Sequence[str] = WINDOWS, libraries: Sequence[str] = ()) -> None:
    """Build the host as ``program``; raises :class:`subprocess.CalledProcessError` if the compiler fails."""
    command = [*compiler, *FLAGS, "-o", str(program.absolute()), SOURCE.name, *libraries]
    subprocess.run(command, cwd=SOURCE.parent, check=True)


if __name__ == "__main__":
    build(SOURCE.with_suffix(".exe"))
