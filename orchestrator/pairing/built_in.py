"""The benchmark's own FMUs, built on first use and kept by what they are made from."""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import tempfile
from importlib import metadata
from pathlib import Path

import fmpy

import build_fmus

from ..cache import cache_folder, source_hash
from ..errors import EnvironmentFault

DEFAULT_CONTROLLER = "DiagonalPID"

SOURCES = ("plant_fmu", "controller_fmu")
ROOT = Path(build_fmus.__file__).resolve().parent

logger = logging.getLogger(__name__)


def built_in(name: str) -> Path:
    """Path of the FMU ``name`` of :data:`build_fmus.NAMES`; it is built if it is missing, or its sources, pythonfmu or
    the compiler's command have changed, or it is not what its folder's name says, the SHA-256 of its bytes.

    Raises :class:`~orchestrator.errors.EnvironmentFault` if it cannot be built, :class:`ValueError` for another name.
    """
    try:
        compiler = build_fmus.find_compiler()
        sources = source_hash(ROOT / folder for folder in SOURCES)
        made_of = repr((sources, metadata.version("pythonfmu"), compiler, fmpy.platform_tuple))
        folder = cache_folder() / "built" / hashlib.sha256(made_of.encode()).hexdigest()[:16] / name
        for file in folder.glob(f"*/{name}.fmu"):
            if file.parent.name == _digest(file):
                return file
            logger.warning("%s in the cache is not what was built there: it is built anew.", file.name)
            shutil.rmtree(file.parent, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
            built = build_fmus.build(name, Path(scratch))
            file = folder / _digest(built) / built.name
            file.parent.mkdir(exist_ok=True)
            os.replace(built, file)
    except (build_fmus.BuildError, OSError) as problem:
        raise EnvironmentFault(f"The FMU {name} cannot be built: {problem}", "cannot-build") from problem
    return file


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()
