"""Text that may come from a stranger, made fit to be shown."""

from __future__ import annotations


def printable(message: bytes | str | None) -> str:
    """Text without control and bidirectional formatting characters except line ends and tabs.

    FMUs send bytes, not always UTF-8; control characters would steer a terminal.
    """
    text = message if isinstance(message, str) else (message or b"").decode(errors="replace")
    return "".join(c if c.isprintable() or c in "\n\r\t" else "\N{REPLACEMENT CHARACTER}" for c in text)
