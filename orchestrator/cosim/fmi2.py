"""FMI 2.0 co-simulation slaves through FMPy: life cycle in Python, addresses for the compiled loop."""

from __future__ import annotations

import ctypes
import os
from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager

from fmpy import calloc, free
from fmpy.fmi1 import FMICallException
from fmpy.fmi2 import (
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from ..errors import FmuError
from .archive import Archive

LOG_LINES = 20
"""Only an FMU's last messages are kept: they are the ones that say what went wrong."""

_log: deque[str] = deque(maxlen=LOG_LINES)


def _on_message(_environment: int, instance: bytes, status: int, _category: bytes, message: bytes) -> None:
    if status > 0:
        _log.append(f"{instance.decode(errors='replace')}: {message.decode(errors='replace').strip()}")


_callbacks = fmi2CallbackFunctions()
_callbacks.logger = fmi2CallbackLoggerTYPE(_on_message)
_callbacks.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
_callbacks.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
addLoggerProxy(ctypes.byref(_callbacks))


def log() -> tuple[str, ...]:
    """The last messages that FMUs of this process sent with a status above OK."""
    return tuple(_log)


class Slave:
    """One loaded FMI 2.0 co-simulation FMU, of which one instance at a time is alive."""

    def __init__(self, archive: Archive) -> None:
        """Load the FMU's library; raises :class:`FmuError` where the platform's loader refuses it."""
        self.archive = archive
        folder = os.getcwd()
        try:
            self._fmu = FMU2Slave(
                guid=archive.description.guid,
                modelIdentifier=archive.description.coSimulation.modelIdentifier,
                unzipDirectory=str(archive.folder),
            )
        except Exception as problem:
            raise FmuError(f"{archive.name} cannot be loaded: {problem}", "load") from problem
        finally:
            os.chdir(folder)  # FMPy leaves a failed load inside the FMU's folder

    @property
    def instance(self) -> int:
        """The instance pointer as an integer."""
        return int(self._fmu.component)

    def address(self, function: str) -> int:
        """Address of the C function ``function``, such as ``fmi2DoStep``."""
        return ctypes.cast(self._fmu.dll[function], ctypes.c_void_p).value or 0

    @contextmanager
    def instantiated(self, stop_time: float) -> Iterator[Slave]:
        """An instance, set up for a simulation from 0 to ``stop_time`` [s] and freed at the end."""
        with self._reported("fmi2Instantiate"):
            _log.clear()
            self._fmu.instantiate(callbacks=_callbacks, loggingOn=True)  # else pythonfmu drops its messages
        try:
            with self._reported("fmi2SetupExperiment"):
                self._fmu.setupExperiment(startTime=0.0, stopTime=stop_time)
            yield self
        finally:
            # Not FMPy's freeInstance: it unloads the library too, and the next instance would call into nothing.
            self._fmu.fmi2FreeInstance(self._fmu.component)

    def initialize(self, before: Mapping[int, float], within: Mapping[int, float]) -> None:
        """Initialize with the values ``before`` (parameters) and ``within`` initialization mode (inputs)."""
        self.set(before)
        with self._reported("fmi2EnterInitializationMode"):
            self._fmu.enterInitializationMode()
        self.set(within)
        with self._reported("fmi2ExitInitializationMode"):
            self._fmu.exitInitializationMode()

    def set(self, values: Mapping[int, float]) -> None:
        """Set real variables by value reference."""
        if values:
            with self._reported("fmi2SetReal"):
                self._fmu.setReal(list(values), list(values.values()))

    def get(self, references: Sequence[int]) -> list[float]:
        """Values of real variables by value reference."""
        with self._reported("fmi2GetReal"):
            return list(self._fmu.getReal(list(references)))

    def terminate(self) -> None:
        """Tell the instance that the simulation is over."""
        with self._reported("fmi2Terminate"):
            self._fmu.terminate()

    @contextmanager
    def _reported(self, call: str) -> Iterator[None]:
        try:
            yield
        except FMICallException as problem:
            raise FmuError(f"{self.archive.name}: {problem}", call, log()) from None
        except Exception as problem:
            raise FmuError(f"{self.archive.name}: {call} failed. {problem}", call, log()) from None
