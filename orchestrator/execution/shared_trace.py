"""The trace that a worker writes and its owner reads after a crash."""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace

from ..fmi.trace import SIZE, Place, Trace
from ..text import printable

if sys.platform == "linux":
    import fcntl


class SharedTrace:
    """A trace in an unlinked file that two processes map: no name is left behind, whoever is killed."""

    def __init__(self, file: int | None = None) -> None:
        self.file = _unnamed_file() if file is None else file
        self._memory = mmap.mmap(self.file, SIZE)
        self.buffer = memoryview(self._memory)

    def read(self) -> Place:
        """Where the simulation is, or was when the worker ended. The worker can write there what it likes."""
        place = Trace(self.buffer).read()
        return replace(place, call=printable(place.call))

    def close(self) -> None:
        """Give the file and its memory back."""
        os.close(self.file)
        with suppress(BufferError):  # an array on it that an exception keeps alive
            self.buffer.release()
            self._memory.close()


def _unnamed_file() -> int:
    """Descriptor of a file of SIZE bytes. On Linux it cannot be cut, which would end whoever reads its memory."""
    if sys.platform == "linux":
        file = os.memfd_create("trace", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(file, SIZE)
        fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_SEAL)
        return file
    with tempfile.TemporaryFile() as fresh:
        fresh.truncate(SIZE)
        return os.dup(fresh.fileno())
