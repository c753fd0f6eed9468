"""The benchmark's own FMUs, built on first use and kept by the content of their sources."""

from __future__ import annotations

from importlib import metadata
from pathlib import Path

import build_fmus

from ..cache import cache_folder, source_hash
from ..errors import EnvironmentFault

PLANT_NAME = "FlexibleManipulator"
DEFAULT_CONTROLLER = "DiagonalPID"

SOURCES = ("plant_fmu", "controller_fmu")
ROOT = Path(build_fmus.__file__).resolve().parent


def built_in(name: str) -> Path:
    """Path of the FMU ``name`` of :data:`build_fmus.NAMES`; it is built if it is missing or its sources changed.

    Raises :class:`~orchestrator.errors.EnvironmentFault` if it cannot be built, :class:`ValueError` for another name.
    """
    fingerprint = f"{source_hash(ROOT / folder for folder in SOURCES)[:16]}-{metadata.version('pythonfmu')}"
    file = cache_folder() / "built" / fingerprint / f"{name}.fmu"
    if not file.is_file():
        try:
            file.parent.mkdir(parents=True, exist_ok=True)
            build_fmus.build(name, file.parent)
        except (build_fmus.BuildError, OSError) as problem:
            raise EnvironmentFault(f"The FMU {name} cannot be built: {problem}", "cannot-build") from problem
    return file
