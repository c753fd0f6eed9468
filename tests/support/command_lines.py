"""The commands: in this process where no process is the subject, or as a user runs them, in one of their own."""

import contextlib
import io
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from orchestrator.cli import guard


@dataclass(frozen=True)
class Finished:
    """What a command left behind."""

    code: int
    out: str
    err: str


def call(module: str, *arguments: object, folder: Path) -> Finished:
    """Run a command in this process, in ``folder``."""
    return called(lambda words: guard.run(module, words), *arguments, folder=folder)


def called(main: Callable[[Sequence[str]], int], *arguments: object, folder: Path) -> Finished:
    """The same with any function that takes the words of a command line."""
    out, err, before = io.StringIO(), io.StringIO(), os.getcwd()
    os.chdir(folder)
    try:
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = main([str(argument) for argument in arguments])
            except SystemExit as end:  # argparse
                code = int(end.code or 0)
    finally:
        os.chdir(before)
    return Finished(code, out.getvalue(), err.getvalue())
