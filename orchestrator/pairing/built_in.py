"""The benchmark's own FMUs, built on first use and kept by what they are made from; in C in place of those in Python,
where this machine makes them with the same bits. The manipulator is one of them, or a file.
"""

from __future__ import annotations

import hashlib
import logging
import os
import shutil
import tempfile
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Final, Literal

import fmpy
import numpy as np

import build_fmus
from build_fmus import find_compiler
from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.cases import case_named
from ..benchmark.protocol import load
from ..cache import cache_folder, plant_hash, source_hash
from ..errors import BenchmarkError, EnvironmentFault, InputError
from ..fmi.archive import Archive, open_archive
from .pairing import Pairing, simulate

DEFAULT_CONTROLLER = "DiagonalPID"

SOURCES = ("plant_fmu", "controller_fmu")
ROOT = Path(build_fmus.__file__).resolve().parent

logger = logging.getLogger(__name__)

PLANT, PLANT_IN_C = "FlexibleManipulator", "FlexibleManipulatorNative"

PYTHON: Final = "python"
NATIVE: Final = "native"
AUTO: Final = "auto"
FILE: Final = "file"
FMUS = {PYTHON: PLANT, NATIVE: PLANT_IN_C}

DEFAULT_IN_C = "DiagonalPID_C"

PROOF_CASE = "c07.random_1.disturbance"
"""The case in which a twin proves equal."""


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
            # An FMU that ran with the user's rights may have changed it:
            # the folder's name is the hash of what was built.
            if file.parent.name == _digest(file):
                return file
            logger.warning("%s in the cache is not what was built there: it is built anew.", file.name)
            shutil.rmtree(file.parent, ignore_errors=True)
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=folder.parent) as scratch:
            built = build_fmus.build(name, Path(scratch))
            file = folder / _digest(built) / built.name
            file.parent.mkdir(exist_ok=True)
            # Two processes may build at once. Both make the same bytes, and neither sees half a file.
            os.replace(built, file)
    except (build_fmus.BuildError, OSError) as problem:
        raise EnvironmentFault(f"The FMU {name} cannot be built: {problem}", "cannot-build") from problem
    return file


def _digest(file: Path) -> str:
    return hashlib.sha256(file.read_bytes()).hexdigest()


def fastest_plant() -> Archive:
    """The manipulator, in C if that gives the same bits."""
    return _fastest(
        "The manipulator", PLANT, PLANT_IN_C, lambda plant: Pairing(plant, open_archive(built_in(DEFAULT_CONTROLLER)))
    )


def fastest_default() -> Archive:
    """The paper's PID, in C if that gives the same bits."""
    return _fastest(
        "The paper's PID",
        DEFAULT_CONTROLLER,
        DEFAULT_IN_C,
        lambda controller: Pairing(open_archive(built_in(PLANT)), controller),
    )


def _fastest(what: str, name: str, twin: str, bench: Callable[[Archive], Pairing]) -> Archive:
    """The FMU ``twin`` if this machine can build it and its build gives, in the case PROOF_CASE on its ``bench``, the
    trajectory of the FMU ``name`` in Python to the last bit, which is tried once; else the latter.

    Why a twin is not used, although there is a compiler, is a warning in the log.
    """
    if find_compiler() is None:
        return open_archive(built_in(name))
    try:
        native = open_archive(built_in(twin))
    except (EnvironmentFault, InputError) as problem:
        logger.warning("%s runs in Python. %s", what, problem)
        return open_archive(built_in(name))
    proof = native.file.with_name("equal.txt")
    with suppress(OSError):
        # The hash of the twin, not a mere mark: another compiler makes another file, which has to prove itself anew.
        if proof.read_text(encoding="utf-8") == native.sha256:
            return native
    python = open_archive(built_in(name))
    if not _are_equal(bench(python), bench(native)):
        logger.warning("%s runs in Python: what the compiler here makes of it gives other bits.", what)
        return python
    with suppress(OSError):  # whoever finds none tries again
        proof.write_text(native.sha256, encoding="utf-8")
    return native


def _are_equal(python: Pairing, native: Pairing) -> bool:
    # A whole case, since compilers differ in fused operations and order of sums, which a few steps may not show.
    case = case_named(load("paper"), NOMINAL, 0, PROOF_CASE)
    try:
        first, second = (simulate(bench, case.scenario) for bench in (python, native))
    except BenchmarkError:
        return False
    names = ("q_m", "X", "measured", "command", "torque")
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)


@dataclass(frozen=True)
class Plant:
    """The manipulator's FMU; ``build`` is "python", "native" or "file".

    ``model`` says what it computes, and is equal for both of the benchmark's own builds: the SHA-256 of their sources;
    or of the file.
    """

    archive: Archive
    build: Literal["python", "native", "file"]
    model: str

    @property
    def nominal(self) -> dict[str, float]:
        """Its nominal parameters by FMI name, SI units."""
        if self.build != FILE:
            return NOMINAL
        start = {variable.name: variable.start for variable in self.archive.description.modelVariables}
        return {name: float(start[name]) for name in NOMINAL}


def choose(given: str | Path) -> Plant:
    """The plant that ``given`` names: "python", "native", a file, or "auto".

    "auto" is the native twin if this machine makes it with the bits of the plant in Python, else the
    latter. Raises :class:`InputError` if a file is no manipulator,
    :class:`~orchestrator.errors.EnvironmentFault` if an FMU cannot be built.
    """
    if given == AUTO:
        return _automatic()
    if given in FMUS:
        return _own(PYTHON if given == PYTHON else NATIVE)
    archive = open_archive(Path(given))
    step = archive.interface.canHandleVariableCommunicationStepSize if archive.kind == "CoSimulation" else True
    # FMI 2.0 and 3.0 co-simulation: only with this flag may the steps differ in length.
    if archive.major_version != "1" and not step:
        message = (
            f"{archive.name} does not declare canHandleVariableCommunicationStepSize, and the manipulator's steps "
        )
        raise InputError(f"{message}vary: events divide them.", "no-plant", archive.name)
    with_start = {variable.name for variable in archive.description.modelVariables if variable.start is not None}
    missing = [name for name in NOMINAL if name not in with_start]
    if missing:
        raise InputError(
            f"{archive.name} is not the manipulator: it has no parameter {', '.join(missing)} with a start value.",
            "no-plant",
            archive.name,
        )
    return Plant(archive, FILE, archive.sha256)


def _own(build: Literal["python", "native"]) -> Plant:
    return Plant(open_archive(built_in(FMUS[build])), build, plant_hash())


def _automatic() -> Plant:
    archive = fastest_plant()
    return Plant(archive, NATIVE if archive.name == f"{PLANT_IN_C}.fmu" else PYTHON, plant_hash())
