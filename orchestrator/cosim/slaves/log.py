"""The FMUs' own messages: kept for the day something goes wrong, few enough to be read."""

from __future__ import annotations

import ctypes
import os
from collections import deque

LOG_LINES = 20
"""Only the last messages are kept: they are the ones that say what went wrong."""

LINE_LENGTH = 500

forget_exception = ctypes.pythonapi.PyErr_Clear
forget_exception.restype = None
"""Drop a pending exception; a callback says so before anything else, see :func:`note`."""

_lines: deque[str] = deque(maxlen=LOG_LINES)
_echo: int | None = None


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
        line = f"{printable(instance)}: {text}"
        _lines.append(line)
        if _echo is not None:
            os.write(_echo, line.encode() + b"\n")


def printable(message: bytes | None) -> str:
    """Bytes as text without control characters, but for the ends of lines and tabs."""
    text = (message or b"").decode(errors="replace")
    return "".join(c if c.isprintable() or c in "\n\r\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


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
