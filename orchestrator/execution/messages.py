"""What a child process sends to its parent, read without trusting it: an FMU in it may write into the pipe, too.

Whoever unpickles what a stranger has written runs the stranger's code. Here only the classes of outcomes and their
parts are made, and a message that is none ends the child, not its parent.
"""

from __future__ import annotations

import dataclasses
import importlib
import io
import os
import pickle
import struct
from collections.abc import Iterator
from enum import Enum
from multiprocessing import connection
from types import MappingProxyType
from typing import Any

from ..errors import BenchmarkError

CHUNK = 1 << 20
LARGEST = 1 << 30
"""Bytes of the largest message: far above a trajectory's."""

OTHERS = {
    ("orchestrator.errors", "_restore"),
    ("fractions", "Fraction"),
    ("numpy", "ndarray"),
    ("numpy", "dtype"),
    ("numpy._core.multiarray", "_reconstruct"),
    ("numpy._core.multiarray", "scalar"),
    ("numpy._core.numeric", "_frombuffer"),
    ("numpy.core.multiarray", "_reconstruct"),
    ("numpy.core.multiarray", "scalar"),
    ("numpy.core.numeric", "_frombuffer"),
}
"""What may be part of a message besides this package's own data classes, enumerations and errors."""


def send(pipe: connection.Connection, message: Any) -> None:
    """Write ``message``; the other end has an :class:`Inbox`."""
    packed = io.BytesIO()
    _Pickler(packed, pickle.HIGHEST_PROTOCOL).dump(message)
    pipe.send_bytes(packed.getbuffer())


class _Pickler(pickle.Pickler):
    dispatch_table = MappingProxyType[Any, Any]({})
    """Ways to pickle that other packages have registered are not used: Dask's would put its own functions in."""


class Garbage(Exception):
    """What came through the pipe is no message of ours."""


class Inbox:
    """The messages that come through the pipe of a multiprocessing connection, read without ever waiting."""

    def __init__(self, descriptor: int) -> None:
        self._descriptor, self._bytes = descriptor, bytearray()

    def receive(self) -> bool:
        """Take what is there, of which there must be something; False at the end."""
        piece = os.read(self._descriptor, CHUNK)
        self._bytes += piece
        return bool(piece)

    def messages(self) -> Iterator[Any]:
        """The messages that are complete; raises :class:`Garbage` for what is none."""
        while (frame := self._frame()) is not None:
            try:
                yield _Unpickler(io.BytesIO(frame)).load()
            except Exception as problem:  # an unpickler raises what it likes
                raise Garbage(str(problem)) from problem

    def _frame(self) -> bytes | None:
        """The next frame: its length as an int32 (-1: as a uint64 behind it), then its bytes."""
        if len(self._bytes) < 4:
            return None
        (length,) = struct.unpack_from("!i", self._bytes)
        start = 4
        if length == -1 and len(self._bytes) >= 12:
            (length,) = struct.unpack_from("!Q", self._bytes, 4)
            start = 12
        if not (0 <= length <= LARGEST or length == -1):
            raise Garbage(f"a message of {length} bytes")
        if length == -1 or len(self._bytes) < start + length:
            return None
        frame = bytes(self._bytes[start : start + length])
        del self._bytes[: start + length]
        return frame


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        found = None
        if (module, name) == ("builtins", "getattr"):
            return _member  # how Python 3.11.0 to 3.11.3 write a member of an enumeration
        if (module, name) in OTHERS or (module.startswith("orchestrator.") and "." not in name):
            found = getattr(importlib.import_module(module), name)
        if (module, name) in OTHERS or _is_data(found):
            return found
        raise pickle.UnpicklingError(f"{module}.{name} has no place in a message")


def _member(kind: Any, name: Any) -> Enum:
    """The member ``name`` of an enumeration, which is all that ``getattr`` may be for in a message."""
    if isinstance(kind, type) and issubclass(kind, Enum) and isinstance(name, str) and name in kind.__members__:
        return kind.__members__[name]
    raise pickle.UnpicklingError("builtins.getattr has no place in a message")


def _is_data(found: Any) -> bool:
    if not isinstance(found, type) or not found.__module__.startswith("orchestrator."):
        return False
    return dataclasses.is_dataclass(found) or issubclass(found, Enum | BenchmarkError)
