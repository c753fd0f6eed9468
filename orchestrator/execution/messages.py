"""What crosses the boundary of a process, and how it is read without trusting the sender.

An FMU in a worker process may write into the worker's channel. So a frame is no longer than the job can need, and is
decoded against the type that is due; anything else is :class:`Garbage`, which ends that worker and nothing more. Trace
and log lie in memory that both sides share: the owner reads them after a crash.
"""

from __future__ import annotations

import mmap
import os
import select
import struct
import sys
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Literal, TypeVar

from ..codec import Malformed, Natural, NonNegative, Struct, convert, pack, unpack
from ..errors import BenchmarkError, Crash, EnvironmentFault, FmuError, InputError
from ..fmi import log, trace
from ..fmi.log import Log
from ..fmi.trace import Place, Trace
from ..text import printable

if sys.platform == "linux":
    import fcntl

T = TypeVar("T")

CHUNK = 1 << 20
OVERHEAD = 1 << 17
"""Bytes that a message may have beside its value: an error's words, and the FMU's own messages with it."""

LENGTH = struct.Struct("!I")

REQUEST, DESCRIPTORS = b".", 4
"""What asks a fork server for a worker: a byte, and with it the descriptors of the worker's channel, output and trace,
and of where to send its process number (or the negative error number) and later its exit code, each as a NUMBER. A
frame with the :class:`Described` FMUs follows."""

NUMBER = struct.Struct("!i")

MAX_TEXT, MAX_LINE, MAX_LINES = 16_000, 500, 40
"""Characters and lines of an error that are sent. With UTF-8's four bytes per character they stay below OVERHEAD."""


class FmuFiles(Struct, frozen=True):
    """An FMU that is extracted to ``folder``; ``digests`` are the SHA-256 of the files to check when it is loaded, and
    ``library`` is as in :class:`~orchestrator.fmi.archive.Archive`."""

    name: str
    sha256: str
    folder: str
    digests: dict[str, str] = {}
    library: Literal["native", "source", "wine"] = "native"


class Described(Struct, frozen=True):
    """The FMUs whose descriptions the worker will need."""

    fmus: tuple[FmuFiles, ...]


class Order(Struct, frozen=True):
    """What a worker is to do: call the function ``work`` ("module:function") for each task.

    If ``isolated`` has words, the controller is loaded by a process that they start, a new one for each simulation, and
    never by the worker. ``core`` is the processor for both, -1 for any.
    """

    plant: FmuFiles
    controller: FmuFiles
    work: str
    tasks: tuple[bytes, ...]
    isolated: tuple[str, ...] = ()
    core: int = -1


class ErrorRecord(Struct, frozen=True):
    """An error of this package's family, as data."""

    kind: Literal["input", "environment", "fmu", "crash", "other"]
    message: str
    what: str = ""
    where: str = ""
    value: str = ""
    nearest: tuple[str, ...] = ()
    call: str = ""
    log: tuple[str, ...] = ()


class Loaded(Struct, frozen=True, tag=True):
    """Both FMUs are loaded: what happens from here on is theirs to answer for."""


class Finished(Struct, frozen=True, tag=True):
    """``value`` is what the work returned for task ``index``, packed; ``wall_time`` [s] is what it took. After the
    ``last`` one, the process runs no further task."""

    index: Natural
    value: bytes
    wall_time: NonNegative
    last: bool = False


class Failed(Struct, frozen=True, tag=True):
    """Task ``index`` raised an error of the FMU's or the user's making."""

    index: Natural
    error: ErrorRecord
    wall_time: NonNegative


Message = Loaded | Finished | Failed


FAMILY: dict[str, tuple[type[BenchmarkError], tuple[str, ...]]] = {
    "fmu": (FmuError, ("call", "log")),
    "input": (InputError, ("what", "where", "value", "nearest")),
    "environment": (EnvironmentFault, ("what",)),
    "crash": (Crash, ("what",)),
    "other": (BenchmarkError, ()),
}
"""The errors by their ``kind``, with the fields they have beside the message."""


def error_record(error: BenchmarkError) -> ErrorRecord:
    """``error`` as data, cut to a length and to text that can be sent."""
    kind, fields = next((kind, fields) for kind, (base, fields) in FAMILY.items() if isinstance(error, base))
    values = {name: getattr(error, name) for name in fields}
    sent = {name: _sent(value) if isinstance(value, str) else _lines(value) for name, value in values.items()}
    return convert({"kind": kind, "message": _sent(str(error), MAX_TEXT), **sent}, ErrorRecord)


def _sent(text: str, longest: int = MAX_LINE) -> str:
    # A lone surrogate, as of a file name that is not UTF-8, cannot be packed.
    return text[:longest].encode(errors="replace").decode()


def _lines(lines: tuple[str, ...]) -> tuple[str, ...]:
    return tuple(map(_sent, lines[-MAX_LINES:]))


def error_of(record: ErrorRecord) -> BenchmarkError:
    """The inverse of :func:`error_record`."""
    base, fields = FAMILY[record.kind]
    error = base(record.message)
    for name in fields:
        setattr(error, name, getattr(record, name))
    return error


def frame(message: Struct) -> bytes:
    """``message`` with its length before it."""
    data = pack(message)
    return LENGTH.pack(len(data)) + data


def readable(descriptors: Iterable[int], patience: float) -> set[int]:
    """Those of ``descriptors`` that can be read without waiting, once there is one or ``patience`` seconds are over."""
    poll = select.poll()  # select.select refuses descriptors above 1023, which a caller with many files has
    for descriptor in descriptors:
        poll.register(descriptor, select.POLLIN)
    return {descriptor for descriptor, _ in poll.poll(max(patience, 0.0) * 1e3)}


def write_all(descriptor: int, data: bytes) -> None:
    """Write all of ``data``."""
    view = memoryview(data)
    while view:
        view = view[os.write(descriptor, view) :]


def read_frame(descriptor: int, kind: type[T], largest: int = sys.maxsize) -> T:
    """The message that the other side sends, read to its end.

    Raises :class:`EOFError` if that is gone, :class:`~orchestrator.codec.Malformed` for anything but a ``kind``.
    """

    def read(size: int) -> bytes:
        data = b""
        while len(data) < size:
            piece = os.read(descriptor, size - len(data))
            if not piece:
                raise EOFError("the other side of the channel is gone")
            data += piece
        return data

    (length,) = LENGTH.unpack(read(LENGTH.size))
    # Before the memory for it is taken: a forged length of 4 GB would end the owner and not the worker.
    if length > largest:
        raise Malformed(f"a message of {length} bytes, where {largest} are the most")
    return unpack(read(length), kind)


class Garbage(Exception):
    """What came through a channel is not a message of ours."""


class Inbox:
    """The messages of a worker, read without ever waiting. A value has at most ``largest`` bytes."""

    def __init__(self, descriptor: int, largest: int) -> None:
        self._descriptor, self._largest, self._bytes = descriptor, largest + OVERHEAD, bytearray()

    def receive(self) -> bool:
        """Take what is there, of which there must be something; False at the end."""
        try:
            piece = os.read(self._descriptor, CHUNK)
        # A worker that is killed with data unread resets the connection; that is its end as well.
        except ConnectionError:
            return False
        self._bytes += piece
        return bool(piece)

    def messages(self) -> Iterator[Message]:
        """The messages that are complete; raises :class:`Garbage` for what is not one."""
        while (data := self._frame()) is not None:
            try:
                yield unpack(data, Message)  # type: ignore[arg-type]  # a union of types
            except Malformed as problem:
                raise Garbage(str(problem)) from problem

    def _frame(self) -> bytes | None:
        if len(self._bytes) < LENGTH.size:
            return None
        (length,) = LENGTH.unpack_from(self._bytes)
        # The same limit as in read_frame: the sender may be an FMU.
        if length > self._largest:
            raise Garbage(f"a message of {length} bytes, where {self._largest} are the most")
        if len(self._bytes) < LENGTH.size + length:
            return None
        data = bytes(self._bytes[LENGTH.size : LENGTH.size + length])
        del self._bytes[: LENGTH.size + length]
        return data


SHARED_BYTES = trace.SIZE + log.SIZE


class SharedTrace:
    """Trace and log in an unlinked file that two processes map: no name is left behind, whoever is killed.

    The worker can write there what it likes.
    """

    def __init__(self, file: int | None = None) -> None:
        self.file = _unnamed_file() if file is None else file
        self._memory = mmap.mmap(self.file, SHARED_BYTES)
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
    """Descriptor of a file of this size. On Linux it cannot be cut, which would end whoever reads its memory."""
    if sys.platform == "linux":
        # A worker that cuts the file would end its owner by SIGBUS, at the next look.
        file = os.memfd_create("trace", os.MFD_CLOEXEC | os.MFD_ALLOW_SEALING)
        os.ftruncate(file, SHARED_BYTES)
        fcntl.fcntl(file, fcntl.F_ADD_SEALS, fcntl.F_SEAL_SHRINK | fcntl.F_SEAL_SEAL)
        return file
    with tempfile.TemporaryFile() as fresh:
        fresh.truncate(SHARED_BYTES)
        return os.dup(fresh.fileno())
