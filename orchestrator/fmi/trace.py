"""Where a simulation is: a few words of memory that can be shared with another process and outlive a crash."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SIZE = 512
"""Bytes of a trace: three int64 words, then three texts."""

SAMPLE, SIDE, CALL = range(3)
"""Words: the sample, whose call it is, and which one of the loop's calls (0 for another)."""

NOBODY, PLANT, CONTROLLER = range(3)
"""Sides. Each has a text: the FMI names of the loop's calls, in their order, and nobody's is that of another call."""

_WORDS, _TEXT = 32, 160


class Trace:
    """A trace in a buffer of SIZE bytes; its words are handed to the compiled loop."""

    def __init__(self, buffer: bytearray | memoryview | None = None) -> None:
        self._bytes = np.frombuffer(buffer if buffer is not None else bytearray(SIZE), dtype=np.uint8)
        self.words = self._bytes[:_WORDS].view(np.int64)

    def note(self, side: int, call: str) -> None:
        """An FMI call outside the loop begins."""
        self._write(NOBODY, call)
        self.words[SIDE], self.words[CALL] = side, 0

    def expect(self, side: int, calls: Sequence[str]) -> None:
        """The loop is about to make these ``calls``: what its numbers, from 1 on, stand for."""
        self._write(side, " ".join(calls))

    def reset(self) -> None:
        """A new simulation begins."""
        self._bytes[:] = 0

    def read(self) -> Place:
        """Where the simulation is."""
        side, call = int(self.words[SIDE]), int(self.words[CALL])
        names = self._text(side).split()
        in_loop = 0 < call <= len(names)
        return Place(int(self.words[SAMPLE]), side, names[call - 1] if in_loop else self._text(NOBODY))

    def _write(self, side: int, text: str) -> None:
        # The memory is fixed, as another process maps it; a longer name is cut.
        encoded = text.encode()[: _TEXT - 1].ljust(_TEXT, b"\0")
        self._place(side)[:] = np.frombuffer(encoded, dtype=np.uint8)

    def _text(self, side: int) -> str:
        # The FMU of a crashed process may have written anything here.
        return self._place(side).tobytes().split(b"\0")[0].decode(errors="replace")

    def _place(self, side: int) -> np.ndarray:
        return self._bytes[_WORDS + side * _TEXT :][:_TEXT]


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
