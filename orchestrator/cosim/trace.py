"""Where a simulation is: a few words of memory that can be shared with another process and outlive a crash."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

SIZE = 256
"""Bytes of a trace: four int64 words, then the name of the FMI call as text."""

SAMPLE, SIDE, CALL = range(3)
"""Words: the sample, whose call it is, and which one of the loop's calls (0 where the text says it)."""

NOBODY, PLANT, CONTROLLER = range(3)
LOOP_CALLS = ("", "set", "step", "get")

_TEXT = 32


class Trace:
    """A trace in a buffer of SIZE bytes; its words are handed to the compiled loop."""

    def __init__(self, buffer: bytearray | memoryview | None = None) -> None:
        self._bytes = np.frombuffer(buffer if buffer is not None else bytearray(SIZE), dtype=np.uint8)
        self.words = self._bytes[:_TEXT].view(np.int64)

    def note(self, side: int, call: str) -> None:
        """An FMI call outside the loop begins."""
        text = call.encode()[: SIZE - _TEXT - 1]
        self._bytes[_TEXT:] = 0
        self._bytes[_TEXT : _TEXT + len(text)] = np.frombuffer(text, dtype=np.uint8)
        self.words[SIDE], self.words[CALL] = side, 0

    def reset(self) -> None:
        """A new simulation begins."""
        self._bytes[:] = 0

    def read(self) -> Place:
        """Where the simulation is."""
        text = self._bytes[_TEXT:].tobytes().split(b"\0")[0].decode(errors="replace")
        call = int(self.words[CALL])
        in_loop = 0 < call < len(LOOP_CALLS)
        return Place(int(self.words[SAMPLE]), int(self.words[SIDE]), LOOP_CALLS[call] if in_loop else text)


@dataclass(frozen=True)
class Place:
    """A point of a simulation: the sample, whose FMI call (NOBODY, PLANT, CONTROLLER), and its name."""

    sample: int
    side: int
    call: str


current = Trace()
"""The trace of this process. A child process that is watched replaces it by a shared one."""


def use(trace: Trace) -> None:
    """Make ``trace`` the one of this process."""
    global current
    current = trace
