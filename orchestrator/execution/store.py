"""Finished results on disk: one committed record per key, which says everything the record depends on."""

from __future__ import annotations

import contextlib
import shutil
import sqlite3
import zlib
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from ..errors import EnvironmentFault, InputError

SCHEMA = """
CREATE TABLE IF NOT EXISTS records (
    key TEXT PRIMARY KEY,      -- hash of all that the record depends on
    label TEXT NOT NULL,       -- for people who look into the file
    record BLOB NOT NULL       -- a checksum of SEAL bytes, and then the record
)
"""

FILE = "cases.sqlite"
BESIDE = (f"{FILE}-wal", f"{FILE}-shm")
"""Files of SQLite's beside it, as long as it is open or after a process was killed."""

MEMORY = ":memory:"
"""SQLite's name for what is not on disk."""

DAMAGED = "damaged-store"
"""Code of the error of a store that is damaged."""

SEAL = 4
"""Bytes of a checksum. SQLite has none: one bit of a criterion that was another gave another V, without a word."""

CHUNK = 500
"""Keys per query; SQLite has a limit on parameters."""


class Store:
    """An open store. Not for use from several threads."""

    def __init__(self, connection: sqlite3.Connection, place: str) -> None:
        self._connection, self._place = connection, place

    @property
    def lasting(self) -> bool:
        """Whether it lasts longer than this process."""
        return self._place != MEMORY

    def get(self, keys: Sequence[str]) -> dict[str, bytes]:
        """The records of those of ``keys`` that have one. What is not what was stored is none."""
        records: dict[str, bytes] = {}
        with self._reported():
            for first in range(0, len(keys), CHUNK):
                chunk = list(keys[first : first + CHUNK])
                marks = ", ".join("?" * len(chunk))
                rows = self._connection.execute(f"SELECT key, record FROM records WHERE key IN ({marks})", chunk)
                records.update(
                    (key, record[SEAL:])
                    for key, record in rows
                    if isinstance(record, bytes) and record[:SEAL] == _seal(key, record[SEAL:])
                )
        return records

    def put(self, key: str, label: str, record: bytes) -> None:
        """Store a record and commit it; a second one of the same key takes the first one's place."""
        with self._reported(), self._connection:
            row = key, label, _seal(key, record) + record
            self._connection.execute("INSERT OR REPLACE INTO records VALUES (?, ?, ?)", row)

    def forget(self, keys: Iterable[str]) -> None:
        """Delete the records of ``keys``."""
        with self._reported(), self._connection:
            self._connection.executemany("DELETE FROM records WHERE key = ?", [(key,) for key in keys])

    @contextmanager
    def _reported(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as problem:
            raise _fault(self._place, problem) from problem


def _seal(key: str, record: bytes) -> bytes:
    """The checksum of a record under its key."""
    return zlib.crc32(record, zlib.crc32(key.encode())).to_bytes(SEAL, "big")


@contextmanager
def opened(folder: Path | None) -> Iterator[Store]:
    """The store in ``folder``, for one process at a time; None is a store that lasts as long as the block.

    Raises :class:`InputError` if another evaluation has it open, :class:`EnvironmentFault` if it is damaged.
    """
    with contextlib.ExitStack() as stack:
        if folder is not None:
            stack.enter_context(_locked(folder))
        place = folder / FILE if folder is not None else MEMORY
        try:
            connection = stack.enter_context(contextlib.closing(sqlite3.connect(place)))
            # A commit appends to one file then, and a reader, such as a report, is not in its way.
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")  # a committed row survives a power cut
            connection.execute(SCHEMA)
        except sqlite3.Error as problem:
            raise _fault(str(place), problem) from problem
        yield Store(connection, str(place))


def _fault(place: str, problem: sqlite3.Error) -> EnvironmentFault:
    # SQLite reports a full disk, a file size limit or a lost network drive as an operational error, and a file that is
    # damaged or no database as another one: only then does it help to move the file away.
    if isinstance(problem, sqlite3.OperationalError):
        what, remedy = "store", "What is committed is kept; make room or repair the folder, and do the same again"
    else:
        what, remedy = DAMAGED, "Move the file away to begin anew"
    return EnvironmentFault(f"The results in {place} cannot be read or written: {problem}. {remedy}.", what)


def forget(folder: Path) -> None:
    """Remove the store in ``folder``: one that is damaged begins anew."""
    for name in (FILE, *BESIDE):
        (folder / name).unlink(missing_ok=True)


def copy(file: Path, target: Path) -> None:
    """Copy the store ``file`` as it is at one moment, while others write to it; a damaged one as it is.

    Raises :class:`OSError` if that fails.
    """
    try:
        # Not file by file: of 150 copies of a store that was written to, 9 were torn.
        read = sqlite3.connect(f"{file.absolute().as_uri()}?mode=rw", uri=True)
        with contextlib.closing(read) as source, contextlib.closing(sqlite3.connect(target)) as other:
            source.backup(other)
    except sqlite3.Error:
        shutil.copy2(file, target)


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    from filelock import FileLock, Timeout  # a single simulation does without

    lock = FileLock(folder / ".lock")
    try:
        # Two evaluations in one folder would each simulate the same cases, and mix two results in one report.
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(f"Another evaluation is writing into {folder}.", "folder-in-use", folder) from None
    except OSError as problem:
        message = f"{lock.lock_file} cannot be locked: {problem.strerror or problem}."
        raise InputError(message, "folder-in-use", folder) from problem
    try:
        yield
    finally:
        lock.release()
