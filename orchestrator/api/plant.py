"""Which FMU is the manipulator: the one in Python, its native twin, or a file."""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

import numpy as np

from build_fmus import find_compiler
from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.cases import case_named
from ..benchmark.protocol import load
from ..cache import plant_hash
from ..errors import BenchmarkError, EnvironmentFault, InputError
from ..fmi.archive import Archive, open_archive
from .built_in import DEFAULT_CONTROLLER, built_in
from .campaign import Bench, simulate

PYTHON: Final = "python"
NATIVE: Final = "native"
AUTO: Final = "auto"
FILE: Final = "file"
FMUS = {PYTHON: "FlexibleManipulator", NATIVE: "FlexibleManipulatorNative"}

PROOF = "c07.random_1.disturbance"
"""The case in which the native twin proves equal."""

logger = logging.getLogger(__name__)


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


def choose(wanted: str | Path) -> Plant:
    """The plant that ``wanted`` names: "python", "native", a file, or "auto".

    "auto" is the native twin if this machine can build it and its build gives, in the case PROOF, the trajectory of the
    plant in Python to the last bit, which is tried once; else the latter, with a note in the log. Raises
    :class:`InputError` if a file is no manipulator, :class:`EnvironmentFault` if an FMU cannot be built.
    """
    if wanted == AUTO:
        return _automatic()
    if wanted in FMUS:
        return _own(PYTHON if wanted == PYTHON else NATIVE)
    archive = open_archive(Path(wanted))
    known = {variable.name for variable in archive.description.modelVariables if variable.start is not None}
    missing = [name for name in NOMINAL if name not in known]
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
    if find_compiler() is None:
        logger.info("the manipulator runs in Python", extra={"what": "no-native"})
        return _own(PYTHON)
    try:
        native = _own(NATIVE)
    except (EnvironmentFault, InputError) as problem:
        logger.warning("The manipulator runs in Python. %s", problem)
        return _own(PYTHON)
    proof = native.archive.file.with_name("equal.txt")
    with suppress(OSError):
        if proof.read_text(encoding="utf-8") == native.archive.sha256:
            return native
    python = _own(PYTHON)
    if not _are_equal(python, native):
        logger.warning("The manipulator runs in Python: what the compiler here makes of it gives other bits.")
        return python
    with suppress(OSError):  # whoever finds none tries again
        proof.write_text(native.archive.sha256, encoding="utf-8")
    return native


def _are_equal(python: Plant, native: Plant) -> bool:
    controller = open_archive(built_in(DEFAULT_CONTROLLER))
    case = case_named(load("paper"), NOMINAL, 0, PROOF)
    try:
        first, second = (simulate(Bench(plant.archive, controller), case.scenario) for plant in (python, native))
    except BenchmarkError:
        return False
    names = ("q_m", "X", "measured", "command", "torque")
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)
