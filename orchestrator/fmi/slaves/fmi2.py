"""FMI 2.0 co-simulation slaves."""

from __future__ import annotations

from fmpy.fmi2 import FMU2Slave, fmi2CallbackFunctions

from .. import port
from . import logger
from .base import Slave, Values

CALLBACKS = logger.callbacks(fmi2CallbackFunctions)


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


class Fmi2CoSimulation(Fmi2):
    """An FMI 2.0 co-simulation slave."""

    fmpy_class = FMU2Slave
    stepping = port.CO_SIMULATION
