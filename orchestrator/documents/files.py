"""Folders and files of a run. A file is written completely or not at all."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

from ..bounded import MAX_RESULT_BYTES, read
from ..errors import EnvironmentFault, InputError

SPREAD = "spread.json"
"""What an evaluation with several seeds writes."""

TUNING = "tuning.json"
"""What a tuning writes."""

SWEEP = "sweep.json"
"""What a sweep writes."""

ROBUSTNESS = "robustness.json"
"""What a search for the worst case writes."""

RELIABILITY = "reliability.json"
"""What a sample of independent draws writes."""

VERIFICATION = "verification.json"
"""The certificate of a verification."""

RESULTS, CASES, TRAJECTORIES = "results.json", "cases.csv", "trajectories.npz"
"""What an evaluation writes into its run's folder."""

REPORT, PARQUET, MAT, FIGURES = "report.html", "cases.parquet", "trajectories.mat", "figures"
"""What is derived from these; FIGURES is a folder."""

SIMULATION = "simulation.html"
"""The page of simulations of single cases."""

PAGE = b'<a class="skip" href="#content">'
"""What all pages have that this package writes, and others have not."""


def seed_folder(seed: int) -> str:
    """The folder of one of several seeds in that of their spread."""
    return f"seed-{seed}"


def prepare_folder(folder: Path) -> None:
    """Create ``folder``; raises :class:`InputError` if it cannot be written to."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as problem:
        message = f"The folder {folder} cannot be written to: {problem.strerror}."
        raise InputError(message, "folder-not-writable", folder) from problem


def check_report(file: Path) -> None:
    """Raise :class:`InputError` unless a report may be written into ``file``: a controller that was named by mistake
    was overwritten with its own page."""
    if file.suffix.lower() not in (".html", ".htm"):
        raise InputError(f"A report is an HTML page: {file} does not end with .html.", "no-report-file", file)
    if file.exists() and PAGE not in read(file, MAX_RESULT_BYTES):
        message = f"{file} is there and is no report of this package: it is not overwritten. Choose another name."
        raise InputError(message, "no-report-file", file)


def check_result(file: Path) -> None:
    """Raise :class:`InputError` for the name of an FMU, in whose place no result is written."""
    if file.suffix.lower() == ".fmu":
        raise InputError(f"{file} is the name of an FMU: results are not written there.", "bad-file-name", file)


def remove(file: Path) -> None:
    """Remove a file or a folder of files if it exists; raises :class:`EnvironmentFault` if that fails."""
    try:
        for inner in file.iterdir() if file.is_dir() else ():
            inner.unlink()
        file.rmdir() if file.is_dir() else file.unlink(missing_ok=True)
    except OSError as problem:
        raise EnvironmentFault(f"{file} cannot be removed: {problem.strerror}.", "not-removed") from problem


def streamed(write: Callable[[IO[bytes]], object]) -> bytes:
    """What ``write`` writes into a binary stream."""
    stream = io.BytesIO()
    write(stream)
    return stream.getvalue()


def write_text(file: Path, text: str) -> None:
    """Write a text file in one go, in UTF-8."""
    write_bytes(file, text.encode("utf-8"))


def write_bytes(file: Path, data: bytes) -> None:
    """Write a file in one go: under its name are the old contents or the new, never a part of them.

    Raises :class:`EnvironmentFault` if that fails, as on a full disk.
    """
    # Two processes may write the same file at a time: each has a scratch file of its own.
    scratch = file.with_name(f".{file.name}.{os.getpid()}")
    try:
        with scratch.open("wb") as stream:
            stream.write(data)
            stream.flush()
            os.fsync(stream.fileno())  # else a power cut may leave the new name without contents
        os.replace(scratch, file)
    except OSError as problem:
        raise EnvironmentFault(f"{file} cannot be written: {problem.strerror}.", "not-written") from problem
    finally:
        with contextlib.suppress(OSError):
            scratch.unlink(missing_ok=True)
