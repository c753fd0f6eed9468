"""What the FMUs of this process have said last, with the file that one in Python looked for."""

from __future__ import annotations

import functools
import os
import sys

from ...text import printable
from .. import log

_missing = ""
"""The last file that Python code in this process wanted to read and that did not exist."""


@functools.cache
def watch_files() -> None:
    """From now on, remember the file that an FMU written in Python looks for and does not find."""
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[object, ...]) -> None:
    global _missing
    reading = event == "open" and isinstance(arguments[0], str) and str(arguments[1]).startswith("r")
    if reading and not os.path.exists(str(arguments[0])):
        _missing = str(arguments[0])


def lines() -> tuple[str, ...]:
    """The last messages of the process's :class:`~orchestrator.fmi.log.Log`."""
    return tuple(map(_with_file, log.current.lines()))


def _with_file(line: str) -> str:
    # pythonfmu sends the error without its file name.
    return f"{line}: {printable(_missing)}" if "FileNotFoundError" in line and _missing not in line else line
