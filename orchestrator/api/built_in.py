"""The benchmark's own FMUs, built on first use and kept by what they are made from."""

from __future__ import annotations

import hashlib
from importlib import metadata
from pathlib import Path

import fmpy

import build_fmus

from ..cache import cache_folder, source_hash
from ..errors import EnvironmentFault

DEFAULT_CONTROLLER = "DiagonalPID"

SOURCES = ("plant_fmu", "controller_fmu")
ROOT = Path(build_fmus.__file__).resolve().parent


def built_in(name: str) -> Path:
    """Path of the FMU ``name`` of :data:`build_fmus.NAMES`; it is built if it is missing, or its sources, pythonfmu or
    the compiler's command have changed.

    Raises :class:`~orchestrator.errors.EnvironmentFault` if it cannot be built, :class:`ValueError` for another name.
    """
    try:
        compiler = build_fmus.find_compiler()
        sources = source_hash(ROOT / folder for folder in SOURCES)
        made_of = repr((sources, metadata.version("pythonfmu"), compiler, fmpy.platform_tuple))
        file = cache_folder() / "built" / hashlib.sha256(made_of.encode()).hexdigest()[:16] / f"{name}.fmu"
        if not file.is_file():
            file.parent.mkdir(parents=True, exist_ok=True)
            build_fmus.build(name, file.parent)
    except (build_fmus.BuildError, OSError) as problem:
        raise EnvironmentFault(f"The FMU {name} cannot be built: {problem}", "cannot-build") from problem
    return file
