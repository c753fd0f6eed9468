"""The trace that a child writes and its parent reads after a crash."""

from __future__ import annotations

import mmap
import os
import sys
import tempfile
from multiprocessing import reduction
from typing import Any

from ..cosim.trace import SIZE, Place, Trace

if sys.platform == "linux":
    import fcntl


class SharedTrace:
    """A trace in an unlinked file that parent and child both map: no name is left behind, whoever is killed."""

    def __init__(self, file: int | None = None) -> None:
        if file is None:
            file = _unnamed_file()
        self.file = file
        self.buffer = memoryview(mmap.mmap(file, SIZE))

    def __reduce__(self) -> tuple[Any, ...]:
        return _attach, (reduction.DupFd(self.file),)

    def read(self) -> Place:
        """Where the simulation is, or was when the child ended."""
        return Trace(self.buffer).read()

    def close(self) -> None:
        """Give the file back."""
        os.close(self.file)


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


def _attach(duplicate: Any) -> SharedTrace:
    return SharedTrace(duplicate.detach())
