"""Folders and files of a run. A file is written completely or not at all."""

from __future__ import annotations

import contextlib
import io
import os
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import IO

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
