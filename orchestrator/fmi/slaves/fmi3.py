"""FMI 3.0 co-simulation slaves."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from fmpy import platform_tuple, sharedLibraryExtension
from fmpy.fmi3 import FMU3Slave

from .. import port
from ..variables import Variable
from . import log
from .base import Slave, Values, library_path


class Fmi3(Slave):
    """What co-simulation and Model Exchange of FMI 3.0 share."""

    with_sizes = True
    calls = {"set": "fmi3SetFloat64", "step": "fmi3DoStep", "get": "fmi3GetFloat64"}

    def _arguments(self, identifier: str) -> dict[str, Any]:
        return {
            "guid": self.archive.description.guid,
            "modelIdentifier": identifier,
            "unzipDirectory": str(self.archive.folder),
            "libraryPath": library_path(self.archive.folder, platform_tuple, identifier, sharedLibraryExtension),
        }

    def _on_message(self, _environment: int, status: int, _category: bytes, message: bytes) -> None:
        log.note(self.archive.file.stem.encode(), status, message)

    def _instantiate(self, stop_time: float) -> None:
        self._stop_time = stop_time
        self._fmu.instantiate(loggingOn=True, logMessage=self._on_message)

    def _reset(self, stop_time: float) -> None:
        self._fmu.reset()

    def _free(self) -> None:
        self._fmu.fmi3FreeInstance(self._fmu.component)

    def _initialize(self, within: Values) -> None:
        self._do(self._fmu.enterInitializationMode, None, 0.0, self._stop_time)
        self.set(within)
        self._do(self._fmu.exitInitializationMode)

    def set(self, values: Values) -> None:
        for variable, own in values.items():
            setter = self._fmu.setFloat32 if variable.type == "Float32" else self._fmu.setFloat64
            self._do(setter, [variable.reference], list(own))

    def get(self, variables: Sequence[Variable]) -> list[float]:
        found: list[float] = []
        for variable in variables:
            getter = self._fmu.getFloat32 if variable.type == "Float32" else self._fmu.getFloat64
            found.extend(self._do(getter, [variable.reference], variable.size))
        return found

    def terminate(self) -> None:
        self._do(self._fmu.terminate)


class Fmi3CoSimulation(Fmi3):
    """An FMI 3.0 co-simulation slave, used without event mode and without early return."""

    stepping = port.CO_SIMULATION_3

    def _load(self) -> Any:
        return FMU3Slave(**self._arguments(self.archive.description.coSimulation.modelIdentifier))
