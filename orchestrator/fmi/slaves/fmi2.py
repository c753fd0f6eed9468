"""FMI 2.0 co-simulation slaves."""

from __future__ import annotations

import ctypes
from collections.abc import Sequence
from typing import Any

from fmpy import calloc, free
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from .. import port
from ..variables import Variable
from . import log
from .base import Slave, Values


def _on_message(_environment: int, instance: bytes, status: int, _category: bytes, message: bytes) -> None:
    log.note(instance, status, message)


CALLBACKS = fmi2CallbackFunctions()
"""One for all instances: the C proxy that formats an FMU's message before it calls back exists once."""
CALLBACKS.logger = fmi2CallbackLoggerTYPE(_on_message)
CALLBACKS.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
CALLBACKS.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
addLoggerProxy(ctypes.byref(CALLBACKS))


class Fmi2(Slave):
    """What co-simulation and Model Exchange of FMI 2.0 share."""

    calls = {"set": "fmi2SetReal", "step": "fmi2DoStep", "get": "fmi2GetReal"}

    def _instantiate(self, stop_time: float) -> None:
        # With logging on: else pythonfmu drops the messages that say why something failed.
        self._fmu.instantiate(callbacks=CALLBACKS, loggingOn=True)
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

    def set(self, values: Values) -> None:
        if values:
            references = [variable.reference for variable in values]
            self._do(self._fmu.setReal, references, [element for own in values.values() for element in own])

    def get(self, variables: Sequence[Variable]) -> list[float]:
        return list(self._do(self._fmu.getReal, [variable.reference for variable in variables]))

    def terminate(self) -> None:
        self._do(self._fmu.terminate)


class Fmi2CoSimulation(Fmi2):
    """An FMI 2.0 co-simulation slave."""

    stepping = port.CO_SIMULATION

    def _load(self) -> Any:
        return FMU2Slave(
            guid=self.archive.description.guid,
            modelIdentifier=self.archive.description.coSimulation.modelIdentifier,
            unzipDirectory=str(self.archive.folder),
        )
