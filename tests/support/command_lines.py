"""The commands: in this process where no process is the subject, or as a user runs them, in one of their own."""

from __future__ import annotations

import contextlib
import io
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import build_fmus
from orchestrator.cli import guard

ROOT = Path(build_fmus.__file__).parent


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    code: int
    out: str
    err: str


def call(module: str, *arguments: object, folder: Path) -> Finished:
    """Run a command in this process, in ``folder``."""
    out, err, before = io.StringIO(), io.StringIO(), os.getcwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = guard.run(module, [str(argument) for argument in arguments])
            except SystemExit as end:  # argparse
                code = int(end.code or 0)
    finally:
        os.chdir(before)
    return Finished(code, out.getvalue(), err.getvalue())


def command(module: str, *arguments: object) -> list[str]:
    """The words of ``python -m orchestrator.MODULE``."""
    return [sys.executable, "-m", f"orchestrator.{module}", *map(str, arguments)]


def environment() -> dict[str, str]:
    """This process's, with this checkout's packages in reach."""
    return {**os.environ, "PYTHONPATH": str(ROOT)}


def run(words: list[str], folder: Path) -> Finished:
    """Run a program in ``folder``, in a process of its own."""
    finished = subprocess.run(
        words, cwd=folder, env=environment(), stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    return Finished(finished.returncode, finished.stdout, finished.stderr)
