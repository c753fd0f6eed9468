"""FMI 1.0 co-simulation slaves."""

from __future__ import annotations

import ctypes
from typing import Any

from fmpy.fmi1 import FMU1Slave, fmi1CallbackFunctions, fmi1True

from .. import port
from . import logger
from .base import Slave, Values

CALLBACKS = logger.callbacks(fmi1CallbackFunctions)


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
        self._fmu.instantiate(functions=CALLBACKS, loggingOn=True)

    def _reset(self, stop_time: float) -> None:
        self._fmu.fmi1ResetSlave(self._fmu.component)

    def _free(self) -> None:
        self._fmu.fmi1FreeSlaveInstance(self._fmu.component)

    def _initialize(self, within: Values) -> None:
        self.set(within)
        self._do(self._fmu.fmi1InitializeSlave, self._fmu.component, 0.0, fmi1True, self._stop_time)
