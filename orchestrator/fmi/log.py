"""What FMUs have said last: memory of a fixed size that can be shared with another process and outlives a crash.

It is a ring. Machine code writes an FMU's messages there (:mod:`.slaves.logger`), from whatever thread they come and
without a lock, so an FMU that never stops logging takes no more memory and no more than its own time. Beside it is kept
the file that an FMU in Python looked for in vain, which its message does not name.
"""

from __future__ import annotations

import ctypes
import functools
import os
import sys

import numpy as np

from ..text import printable

LINES, MAX_LINE_LENGTH = 20, 500
"""Messages that are shown, the last ones, which say what went wrong; and characters of each."""

COUNT, KEPT = range(2)
"""int64 words: messages of any status; those of a status above OK, which are kept."""

HEAD, SLOTS, SLOT = 64, 32, 1152
"""Bytes before the slots; their number, a power of 2; and the bytes of each. Message number n is in slot n % SLOTS."""

INSTANCE, TEXT = 8, 128
"""Where in a slot the instance's name begins, and the message, both ended by a zero byte. Before them is an int64,
the message's number from 1 on, which is written last: a slot with another one is being written."""

MAX_COUNT = 2**53
"""Largest number of messages that is told: whoever writes them may write another one, too."""

SIZE = HEAD + SLOTS * SLOT
"""Bytes of all."""


class Log:
    """A ring of messages in a buffer of SIZE bytes. Its writers may be foreign: no content of it raises anything."""

    def __init__(self, buffer: bytearray | memoryview | bytes | None = None) -> None:
        self._bytes = np.frombuffer(buffer if buffer is not None else bytearray(SIZE), dtype=np.uint8)
        self._head = self._bytes[:HEAD].view(np.int64)
        self._slots = self._bytes[HEAD:].reshape(SLOTS, SLOT)

    @property
    def address(self) -> int:
        """Where it is in memory."""
        return int(self._bytes.ctypes.data)

    @property
    def count(self) -> int:
        """Number of messages, of any status, since it was cleared."""
        return min(max(int(self._head[COUNT]), 0), MAX_COUNT)

    def clear(self) -> None:
        """Forget all messages."""
        self._head[:] = 0
        self._slots[:, :INSTANCE] = 0

    def keep(self, message: bytes, instance: bytes = b"") -> None:
        """Write a message as an FMU does."""
        number = int(self._head[KEPT])
        slot = self._slots[number % SLOTS]
        for begin, end, text in ((INSTANCE, TEXT, instance), (TEXT, SLOT, message)):
            slot[begin:end] = np.frombuffer(text[: end - begin - 1].ljust(end - begin, b"\0"), dtype=np.uint8)
        # Last: a reader takes a slot only if this number is the one that it expects.
        slot[:INSTANCE].view(np.int64)[0] = number + 1
        self._head[:2] += 1

    def take(self, other: Log) -> None:
        """Keep the last messages of another log as well, and count all of them."""
        lines = other.lines()
        for line in lines:
            self.keep(line.encode())
        self._head[COUNT] += other.count - len(lines)

    def lines(self) -> tuple[str, ...]:
        """The last messages, fit for a terminal: FMUs send bytes, not always UTF-8, with control characters."""
        kept = max(int(self._head[KEPT]), 0)
        slots = ((number + 1, self._slots[number % SLOTS].tobytes()) for number in range(max(kept - LINES, 0), kept))
        # Another process may be writing, or have crashed in a message: half a message is left out.
        whole = (_line(slot) for number, slot in slots if int.from_bytes(slot[:INSTANCE], "little") == number)
        return tuple(filter(None, whole))


def _line(slot: bytes) -> str:
    instance, text = (printable(part.split(b"\0")[0]) for part in (slot[INSTANCE:TEXT], slot[TEXT:]))
    text = "; ".join(text.split("\n")).strip("; \r\t")[:MAX_LINE_LENGTH]
    return f"{instance}: {text}" if instance and text else text or instance


current = Log()
"""The log of this process. A child process that is watched replaces it by a shared one."""

place = ctypes.c_void_p(current.address)
"""Where it is, for machine code."""


def use(log: Log) -> None:
    """Make ``log`` the one of this process."""
    global current
    current, place.value = log, log.address


_missing = ""
"""The last file that Python code in this process wanted to read and that did not exist."""


@functools.cache
def watch_files() -> None:
    """From now on, remember the file that an FMU written in Python looks for and does not find."""
    # Once in a process: an audit hook cannot be removed.
    sys.addaudithook(_on_event)


def _on_event(event: str, arguments: tuple[object, ...]) -> None:
    global _missing
    reading = event == "open" and isinstance(arguments[0], str) and str(arguments[1]).startswith("r")
    if reading and not os.path.exists(str(arguments[0])):
        _missing = str(arguments[0])


def last_lines() -> tuple[str, ...]:
    """The last messages of the process's :class:`~orchestrator.fmi.log.Log`."""
    return tuple(map(_with_file, current.lines()))


def _with_file(line: str) -> str:
    # pythonfmu sends the error without its file name.
    return f"{line}: {printable(_missing)}" if "FileNotFoundError" in line and _missing not in line else line
