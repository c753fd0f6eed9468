"""The benchmark's own FMUs, built on first use and kept by the content of their sources."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import build_fmus

from .errors import InputError
from .folders import cache_folder, source_hash

PLANT = "FlexibleManipulator"
DEFAULT_CONTROLLER = "DiagonalPID"

SOURCES = ("plant_fmu", "controller_fmu")
ROOT = Path(build_fmus.__file__).resolve().parent


def own_fmu(name: str) -> Path:
    """Path of the FMU ``name`` of :data:`build_fmus.NAMES`; it is built where it is missing or its sources changed."""
    file = cache_folder() / "built" / _fingerprint() / f"{name}.fmu"
    if not file.is_file():
        try:
            build_fmus.build(name, file.parent)
        except (build_fmus.BuildError, OSError) as problem:
            raise InputError(f"The FMU {name} is missing and cannot be built: {problem}") from problem
    return file


def _fingerprint() -> str:
    return f"{source_hash(ROOT / folder for folder in SOURCES)[:16]}-{metadata.version('pythonfmu')}"
