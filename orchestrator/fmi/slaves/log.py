"""The FMUs' own messages: the last ones are kept, to be shown if something goes wrong."""

from __future__ import annotations

import ctypes
import functools
import os
import sys
from collections import deque
from typing import Any

from fmpy import calloc, free
from fmpy.logging import addLoggerProxy

from ...text import printable

LOG_LINES = 20
"""Only the last messages are kept: they are the ones that say what went wrong."""

LINE_LENGTH = 500

forget_exception = ctypes.pythonapi.PyErr_Clear
forget_exception.restype = None
"""Drop a pending exception; a callback does so before anything else, see :func:`note`."""

_lines: deque[str] = deque(maxlen=LOG_LINES)
_echo: int | None = None
_missing = ""
"""The last file that Python code in this process wanted to read and that did not exist."""


def note(instance: bytes, status: int, message: bytes) -> None:
    """Keep a message that an FMU sent with a status above OK. FMUs send bytes, not always UTF-8 nor fit for a
    terminal, which control characters would steer.

    An FMU written in Python shares this interpreter, and pythonfmu sends its messages while the exception is pending
    that its slave has raised. Any call of C code here would fail with that, so it is forgotten; the call that raised
    it fails all the same.
    """
    forget_exception()
    if status > 0:
        text = "; ".join(printable(message).split("\n")).strip("; \r\t")[:LINE_LENGTH]
        if "FileNotFoundError" in text and _missing not in text:  # pythonfmu sends the error without its file name
            text += f": {printable(_missing)}"
        line = f"{printable(instance)}: {text}"
        _lines.append(line)
        if _echo is not None:
            os.write(_echo, line.encode() + b"\n")


def keep(line: bytes) -> None:
    """Keep a message that another process has formatted and printed."""
    _lines.append(printable(line)[:LINE_LENGTH])


def callbacks(kind: type[ctypes.Structure]) -> ctypes.Structure:
    """FMPy's callbacks of FMI 1 or 2 that keep messages; for all instances one, since the C proxy that formats an FMU's
    message before it calls back exists once."""

    def on_message(_owner: int, instance: bytes, status: int, _category: bytes, message: bytes) -> None:
        note(instance, status, message)

    functions = {"logger": on_message, "allocateMemory": calloc, "freeMemory": free}
    types: dict[str, Any] = dict(kind._fields_)  # type: ignore[arg-type]
    made = kind(**{name: types[name](function) for name, function in functions.items()})
    addLoggerProxy(ctypes.byref(made))
    return made


@functools.cache
def watch_files() -> None:
    """From now on, remember the file that an FMU written in Python looks for and does not find."""
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[object, ...]) -> None:
    global _missing
    reading = event == "open" and isinstance(arguments[0], str) and str(arguments[1]).startswith("r")
    if reading and not os.path.exists(str(arguments[0])):
        _missing = str(arguments[0])


def echo_to(descriptor: int) -> None:
    """Write every message to a file descriptor as well, so that it outlives a crash of this process."""
    global _echo
    _echo = descriptor


def lines() -> tuple[str, ...]:
    """The messages kept."""
    return tuple(_lines)


def clear() -> None:
    """Forget all messages; called when an instance begins."""
    _lines.clear()
