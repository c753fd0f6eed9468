"""Finished results on disk: one committed row a case, found again by everything the result depends on."""

from __future__ import annotations

import contextlib
import functools
import hashlib
import json
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict
from importlib import metadata
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from ..benchmark.case import Case
from ..benchmark.metrics import CaseResult, Measurement
from ..benchmark.protocol import Protocol
from ..cosim.trajectory import Status
from ..errors import BenchmarkError, InputError
from ..folders import source_hash
from .evaluation import Bench

SCHEMA = """
CREATE TABLE IF NOT EXISTS results (
    key TEXT PRIMARY KEY,      -- hash of all that the result depends on
    case_id TEXT NOT NULL,
    record TEXT NOT NULL       -- JSON, see to_record
)
"""

PACKAGE = Path(__file__).resolve().parent.parent
COSIM, BENCHMARK = PACKAGE / "cosim", PACKAGE / "benchmark"

LASTING = (Status.DONE, Status.UNSTABLE)
"""What depends on the key alone; a failure may depend on the conditions, too: a timeout on the time limit."""


class Store:
    """An open store. Not for use from several threads."""

    def __init__(self, connection: sqlite3.Connection, file: Path) -> None:
        self._connection, self._file = connection, file

    def load(self, keys: Mapping[Case, str], conditions: str = "", failures: bool = True) -> list[CaseResult]:
        """The stored results of the cases in ``keys``: those that last, and ``failures`` under these ``conditions``."""
        with self._told():
            rows = dict(self._connection.execute("SELECT key, record FROM results"))
        found = []
        for case, key in keys.items():
            with contextlib.suppress(ValueError, KeyError, TypeError):  # a record that makes no sense is none
                record = json.loads(rows[key])
                failure = Status(record["status"]) not in LASTING
                if not failure or (failures and record.get("conditions", "") == conditions):
                    found.append(from_record(case, record))
        return found

    def put(self, key: str, result: CaseResult, conditions: str = "") -> None:
        """Store a result and commit it; a second one of the same key takes the first one's place."""
        row = (key, result.case.id, json.dumps({**to_record(result), "conditions": conditions}))
        with self._told(), self._connection:
            self._connection.execute("INSERT OR REPLACE INTO results VALUES (?, ?, ?)", row)

    def forget(self, keys: Sequence[str]) -> None:
        """Delete the results of ``keys``."""
        with self._told(), self._connection:
            self._connection.executemany("DELETE FROM results WHERE key = ?", [(key,) for key in keys])

    @contextmanager
    def _told(self) -> Iterator[None]:
        try:
            yield
        except sqlite3.Error as problem:
            raise BenchmarkError(
                f"The results in {self._file} cannot be read or written: {problem}. What is committed is kept; make "
                "room or mend the folder, and run the same command again."
            ) from problem


@contextmanager
def opened(folder: Path) -> Iterator[Store]:
    """The store in ``folder``, for one process at a time.

    Raises :class:`InputError` where another evaluation has it open, :class:`BenchmarkError` where it is damaged.
    """
    lock = FileLock(folder / ".lock")
    try:
        lock.acquire(timeout=0)
    except Timeout:
        raise InputError(
            f"Another evaluation is writing into {folder}. Wait for it, or choose another folder with --output-dir."
        ) from None
    except OSError as problem:
        raise InputError(
            f"{lock.lock_file} cannot be locked: {problem.strerror or problem}. Remove it, or choose another folder "
            "with --output-dir."
        ) from problem
    file = folder / "cases.sqlite"
    try:
        connection = sqlite3.connect(file)
        try:
            connection.execute("PRAGMA journal_mode = WAL")
            connection.execute("PRAGMA synchronous = FULL")  # a committed row survives a power cut
            connection.execute(SCHEMA)
            yield Store(connection, file)
        finally:
            connection.close()
    except sqlite3.Error as problem:
        raise BenchmarkError(
            f"The results in {file} cannot be opened: {problem}. Move the file away to begin anew."
        ) from problem
    finally:
        lock.release()


def keys(protocol: Protocol, cases: Sequence[Case], bench: Bench) -> dict[Case, str]:
    """The key of each case: a hash of the FMUs' bytes, their parameters, the scenario, how it is judged, and the code
    that simulates and judges it."""
    common = hashlib.sha256(
        json.dumps(
            [
                protocol.benchmark,
                _code(),
                bench.plant.sha256,
                bench.controller.sha256,
                sorted(bench.setup.parameters.items()),
                sorted(bench.setup.mapping.items()),
                [protocol.raw["settling"], protocol.raw["stability"]],
            ],
            sort_keys=True,
        ).encode()
    )

    def key(case: Case) -> str:
        digest = common.copy()
        digest.update(repr((case.scenario, case.test)).encode())
        return digest.hexdigest()

    return {case: key(case) for case in cases}


@functools.cache
def _code() -> list[str]:
    """What numbers may change with: the sources of the master and of the benchmark, and the libraries they compute
    with: FMPy brings the solver of Model Exchange."""
    return [source_hash([COSIM, BENCHMARK]), *(metadata.version(library) for library in ("numpy", "numba", "fmpy"))]


def conditions(bench: Bench) -> str:
    """What a failure may depend on beside its key: limits, and whether there is a sandbox."""
    return json.dumps([bench.timeout, bench.limits.memory, bench.limits.output, bench.sandbox])


def to_record(result: CaseResult) -> dict[str, Any]:
    """A result as plain data, without its case."""
    return {
        "status": result.status.value,
        "time": result.time,
        "message": result.message,
        "measurement": asdict(result.measurement) if result.measurement else None,
        "warnings": result.warnings,
        "wall_time": result.wall_time,
        "kind": result.kind,
    }


def from_record(case: Case, record: Mapping[str, Any]) -> CaseResult:
    """The inverse of :func:`to_record`."""
    raw = record["measurement"]
    measurement = None
    if raw is not None:
        cycle = raw["limit_cycle"]
        measurement = Measurement(**{**raw, "limit_cycle": tuple(cycle) if cycle is not None else None})
    return CaseResult(
        case=case,
        status=Status(record["status"]),
        time=record["time"],
        message=record["message"],
        measurement=measurement,
        warnings=record["warnings"],
        wall_time=record["wall_time"],
        kind=record["kind"],
    )
