"""Text that may come from a stranger, made fit to be shown."""

from __future__ import annotations

import re

from .codec import Scalar


def printable(message: bytes | str | None) -> str:
    """Text without control and bidirectional formatting characters except line ends and tabs.

    FMUs send bytes, not always UTF-8; control characters would steer a terminal: a lone carriage return lets what
    follows take the place of what was there.
    """
    text = message if isinstance(message, str) else (message or b"").decode(errors="replace")
    text = text.replace("\r\n", "\n")
    return "".join(c if c.isprintable() or c in "\n\t" else "\N{REPLACEMENT CHARACTER}" for c in text)


def spelled(value: Scalar) -> str:
    """The value of a parameter as a command line takes it, to the last bit."""
    if isinstance(value, bool):
        return "true" if value else "false"
    return repr(value) if isinstance(value, float) else str(value)


def shortened(value: Scalar) -> str:
    """The value of a parameter for people."""
    return f"{value:g}" if isinstance(value, float) else spelled(value)


def file_name(text: str) -> str:
    """Text as one part of a path: no separators, nothing that a shell or a terminal takes for its own, no dot first."""
    return re.sub(r"[^\w.=+\-\[\], ]|^\.", "_", text)
