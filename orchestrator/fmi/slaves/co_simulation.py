"""Co-simulation slaves of FMI 1.0, 2.0 and 3.0."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from fmpy.fmi1 import FMU1Slave, fmi1CallbackFunctions, fmi1True
from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions
from fmpy.fmi3 import FMU3Slave

from .. import port
from ..variables import Variable
from . import logger
from .base import Slave, Values

CALLBACKS_1 = logger.callbacks(fmi1CallbackFunctions)


class Fmi1CoSimulation(Slave):
    """An FMI 1.0 co-simulation slave. There is no initialization mode: everything is set before initializeSlave.

    Its doStep takes a one-byte Boolean where FMI 2 takes an int; in a register that is the same.
    """

    fmpy_class = FMU1Slave
    stepping = port.CO_SIMULATION
    calls = {"set": "fmi1SetReal", "step": "fmi1DoStep", "get": "fmi1GetReal"}

    def _load(self) -> Any:
        fmu = super()._load()
        # FMPy declares it as returning a string, and any status but OK would be followed as a pointer.
        fmu._functions["fmi1InitializeSlave"].restype = ctypes.c_int
        return fmu

    def _instantiate(self, stop_time: float) -> None:
        self._stop_time = stop_time
        self._fmu.instantiate(functions=CALLBACKS_1, loggingOn=True)

    def _reset(self, stop_time: float) -> None:
        self._fmu.fmi1ResetSlave(self._fmu.component)

    def _free(self) -> None:
        # Not freeInstance, which unloads the library as well.
        self._fmu.fmi1FreeSlaveInstance(self._fmu.component)

    def _initialize(self, within: Values) -> None:
        self.set(within)
        self._do(self._fmu.fmi1InitializeSlave, self._fmu.component, 0.0, fmi1True, self._stop_time)


CALLBACKS_2 = logger.callbacks(fmi2CallbackFunctions)


class Fmi2(Slave):
    """What co-simulation and Model Exchange of FMI 2.0 share."""

    calls = {"set": "fmi2SetReal", "step": "fmi2DoStep", "get": "fmi2GetReal"}

    def _instantiate(self, stop_time: float) -> None:
        # With logging on: else pythonfmu drops the messages that say why something failed.
        self._fmu.instantiate(callbacks=CALLBACKS_2, loggingOn=True)
        self._fmu.setupExperiment(startTime=0.0, stopTime=stop_time)

    def _reset(self, stop_time: float) -> None:
        self._fmu.reset()
        self._fmu.setupExperiment(startTime=0.0, stopTime=stop_time)

    def _free(self) -> None:
        self._fmu.fmi2FreeInstance(self._fmu.component)

    def _initialize(self, within: Values) -> None:
        self._do(self._fmu.enterInitializationMode)
        self.set(within)
        self._do(self._fmu.exitInitializationMode)


class Fmi2CoSimulation(Fmi2):
    """An FMI 2.0 co-simulation slave."""

    fmpy_class = FMU2Slave
    stepping = port.CO_SIMULATION


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
            # FMI 3.0 sets an enumeration as Int64.
            kind = "Int64" if variable.type == "Enumeration" else variable.type
            given: list[Any] = list(elements)
            if kind == "Binary":
                given = [bytes.fromhex(element) for element in given]
            self._do(getattr(self._fmu, f"set{kind}"), [variable.reference], given)

    def get(self, variables: Sequence[Variable]) -> list[float]:
        values: list[float] = []
        for variable in variables:
            # One call for each variable, as only this takes the number of values of an array.
            if variable.type == "Float32":
                values += self._got(self.calls["get"].replace("64", "32"), ctypes.c_float, [variable])
            else:
                values += self._got(self.calls["get"], ctypes.c_double, [variable])
        return values


class Fmi3CoSimulation(Fmi3):
    """An FMI 3.0 co-simulation slave, used without event mode and without early return."""

    fmpy_class = FMU3Slave
    stepping = port.CO_SIMULATION_3
