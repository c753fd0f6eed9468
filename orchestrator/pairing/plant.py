"""Which FMU is the manipulator: the one in Python, its native twin, or a file."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final, Literal

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..cache import plant_hash
from ..errors import InputError
from ..fmi.archive import Archive, open_archive
from .built_in import PLANT, PLANT_IN_C, built_in, fastest_plant

PYTHON: Final = "python"
NATIVE: Final = "native"
AUTO: Final = "auto"
FILE: Final = "file"
FMUS = {PYTHON: PLANT, NATIVE: PLANT_IN_C}


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

    "auto" is the native twin if this machine makes it with the bits of the plant in Python (:mod:`.built_in`), else the
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
