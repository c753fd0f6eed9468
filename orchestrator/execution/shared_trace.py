"""Trace and log that a worker writes, and its owner reads after a crash."""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from contextlib import suppress
from dataclasses import replace

from ..fmi import log, trace
from ..fmi.log import Log
from ..fmi.trace import Place, Trace
from ..text import printable

if sys.platform == "linux":
    import fcntl


SIZE = trace.SIZE + log.SIZE


class SharedTrace:
    """Trace and log in an unlinked file that two processes map: no name is left behind, whoever is killed.

    The worker can write there what it likes.
    """

    def __init__(self, file: int | None = None) -> None:
        self.file = _unnamed_file() if file is None else file
        self._memory = mmap.mmap(self.file, SIZE)
        self._whole = memoryview(self._memory)
        self.buffer, self.log_buffer = self._whole[: trace.SIZE], self._whole[trace.SIZE :]

    def read(self) -> Place:
        """Where the simulation is, or was when the worker ended."""
        place = Trace(self.buffer).read()
        return replace(place, call=printable(place.call))

    def logged(self) -> tuple[int, tuple[str, ...]]:
        """How many messages the FMUs have logged in this simulation, and the last ones that say more than OK."""
        read = Log(self.log_buffer)
        return read.count, read.lines()

    def close(self) -> None:
        """Give the file and its memory back."""
        os.close(self.file)
        with suppress(BufferError):  # an array on it that an exception keeps alive
            self.buffer.release()
            self.log_buffer.release()
            self._whole.release()
            self._memory.close()


def _unnamed_file() -> int:
    """Descriptor of a file of SIZE bytes. On Linux it cannot be cut, which would end whoever reads its memory."""
    if sys.platform == "linux":
        # A worker that cuts the file would end its owner by SIGBUS, at the next look.
        file = os.memfd_create("trace", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(file, SIZE)
        fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_SEAL)
        return file
    with tempfile.TemporaryFile() as fresh:
        fresh.truncate(SIZE)
        return os.dup(fresh.fileno())
