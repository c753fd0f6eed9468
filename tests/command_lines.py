"""The commands as a user runs them: in a process of their own, with an empty home."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import build_fmus

ROOT = Path(build_fmus.__file__).parent


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    code: int
    out: str
    err: str


def command(module: str, *arguments: object) -> list[str]:
    """The words of ``python -m orchestrator.MODULE``."""
    return [sys.executable, "-m", f"orchestrator.{module}", *map(str, arguments)]


def environment(**changes: str) -> dict[str, str]:
    """This process's, with this checkout's packages in reach and output as on no terminal."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **changes}


def run(module: str, *arguments: object, folder: Path, changes: Mapping[str, str] | None = None) -> Finished:
    """Run a command in ``folder``."""
    finished = subprocess.run(
        command(module, *arguments),
        cwd=folder,
        env=environment(**(changes or {})),
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    return Finished(finished.returncode, finished.stdout, finished.stderr)
