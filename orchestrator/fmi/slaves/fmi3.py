"""FMI 3.0 co-simulation slaves."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from fmpy.fmi3 import FMU3Slave

from .. import port
from ..variables import Variable
from . import logger
from .base import Slave, Values


class Fmi3(Slave):
    """What co-simulation and Model Exchange of FMI 3.0 share."""

    with_sizes = True
    calls = {"set": "fmi3SetFloat64", "step": "fmi3DoStep", "get": "fmi3GetFloat64"}

    def _instantiate(self, stop_time: float) -> None:
        self._stop_time = stop_time
        self._fmu.instantiate(loggingOn=True, logMessage=logger.logger_3(self.side, self.archive.file.stem))

    def _reset(self, stop_time: float) -> None:
        self._fmu.reset()

    def _free(self) -> None:
        self._fmu.fmi3FreeInstance(self._fmu.component)

    def _initialize(self, within: Values) -> None:
        self._do(self._fmu.enterInitializationMode, None, 0.0, self._stop_time)
        self.set(within)
        self._do(self._fmu.exitInitializationMode)

    def set(self, values: Values) -> None:
        for variable, elements in values.items():
            kind = "Int64" if variable.type == "Enumeration" else variable.type
            given: list[Any] = list(elements)
            if kind == "Binary":
                given = [bytes.fromhex(element) for element in given]
            self._do(getattr(self._fmu, f"set{kind}"), [variable.reference], given)

    def get(self, variables: Sequence[Variable]) -> list[float]:
        found: list[float] = []
        for variable in variables:
            if variable.type == "Float32":
                found += self._got(self.calls["get"].replace("64", "32"), ctypes.c_float, [variable])
            else:
                found += self._got(self.calls["get"], ctypes.c_double, [variable])
        return found


class Fmi3CoSimulation(Fmi3):
    """An FMI 3.0 co-simulation slave, used without event mode and without early return."""

    fmpy_class = FMU3Slave
    stepping = port.CO_SIMULATION_3
