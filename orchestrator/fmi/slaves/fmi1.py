"""FMI 1.0 co-simulation slaves."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from fmpy import calloc, free
from fmpy.fmi1 import (
    FMU1Slave,
    fmi1CallbackAllocateMemoryTYPE,
    fmi1CallbackFreeMemoryTYPE,
    fmi1CallbackFunctions,
    fmi1CallbackLoggerTYPE,
    fmi1True,
)
from fmpy.logging import addLoggerProxy

from .. import port
from ..variables import Variable
from . import log
from .base import Slave, Values


def _on_message(_component: int, instance: bytes, status: int, _category: bytes, message: bytes) -> None:
    log.note(instance, status, message)


_callbacks = fmi1CallbackFunctions()
_callbacks.logger = fmi1CallbackLoggerTYPE(_on_message)
_callbacks.allocateMemory = fmi1CallbackAllocateMemoryTYPE(calloc)
_callbacks.freeMemory = fmi1CallbackFreeMemoryTYPE(free)
_callbacks.stepFinished = None
addLoggerProxy(ctypes.byref(_callbacks))


class Fmi1CoSimulation(Slave):
    """An FMI 1.0 co-simulation slave. There is no initialization mode: everything is set before initializeSlave.

    Its doStep takes a one-byte Boolean where FMI 2 takes an int; in a register that is the same.
    """

    stepping = port.CO_SIMULATION
    calls = {"set": "fmi1SetReal", "step": "fmi1DoStep", "get": "fmi1GetReal"}

    def _load(self) -> Any:
        fmu = FMU1Slave(
            guid=self.archive.description.guid,
            modelIdentifier=self.archive.description.coSimulation.modelIdentifier,
            unzipDirectory=str(self.archive.folder),
        )
        # FMPy declares it as returning a string, and any status but OK would be followed as a pointer.
        fmu._functions["fmi1InitializeSlave"].restype = ctypes.c_int
        return fmu

    def _instantiate(self, stop_time: float) -> None:
        self._stop_time = stop_time
        self._fmu.instantiate(functions=_callbacks, loggingOn=True)

    def _reset(self, stop_time: float) -> None:
        self._fmu.fmi1ResetSlave(self._fmu.component)

    def _free(self) -> None:
        self._fmu.fmi1FreeSlaveInstance(self._fmu.component)

    def _initialize(self, within: Values) -> None:
        self.set(within)
        self._do(self._fmu.fmi1InitializeSlave, self._fmu.component, 0.0, fmi1True, self._stop_time)

    def set(self, values: Values) -> None:
        if values:
            references = [variable.reference for variable in values]
            self._do(self._fmu.setReal, references, [element for own in values.values() for element in own])

    def get(self, variables: Sequence[Variable]) -> list[float]:
        return list(self._do(self._fmu.getReal, [variable.reference for variable in variables]))

    def terminate(self) -> None:
        self._do(self._fmu.terminate)
