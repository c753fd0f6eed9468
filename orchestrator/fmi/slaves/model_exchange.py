"""Model Exchange controllers of FMI 2.0 and 3.0.

The compiled loop takes them from event to event, see :mod:`orchestrator.fmi.port`. If there are continuous states or
event indicators, CVode works in between, through callbacks into Python: 20 to 30 times slower than a controller that is
only sampled, but that is the solver's work.
"""

from __future__ import annotations

import ctypes
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model
from fmpy.sundials import CVodeSolver

from .. import port as ports
from ..port import Port
from ..variables import Variable
from . import log
from .base import Slave
from .fmi2 import Fmi2
from .fmi3 import Fmi3

RELATIVE_TOLERANCE = 1e-8
"""The solver's tolerance; a sample is so short that a tighter one costs hardly any steps."""

STEP_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
ERROR = 3


class _NoInput:
    """Inputs are set by the master and held; the solver has none to apply."""

    def apply(self, time: float) -> None:
        """Do nothing."""


class Solver:
    """CVode for a Model Exchange FMU with continuous states or event indicators, called from the compiled loop."""

    def __init__(self, fmu: Any, clock: np.ndarray, make: Callable[[float], CVodeSolver]) -> None:
        """``clock`` is the port's; ``make`` makes the solver, given its start time, once the FMU has its states."""
        self._fmu, self._clock, self._make = fmu, clock, make
        self._solver: CVodeSolver | None = None
        self._callback = STEP_CALLBACK(self._guarded)

    @property
    def address(self) -> int:
        """The address of a C function with the arguments of fmi2DoStep."""
        return ctypes.cast(self._callback, ctypes.c_void_p).value or 0

    def _guarded(self, _instance: int, time: float, step: float, _flag: int) -> int:
        # An exception that leaves a callback becomes 0 = OK for its caller in C.
        try:
            self._integrate(time, time + step)
        except Exception as problem:
            log.note(self._fmu.instanceName.encode(), ERROR, f"solving by CVode failed: {problem}".encode())
            return ERROR
        return 0

    def _integrate(self, time: float, goal: float) -> None:
        """Up to ``goal`` [s] or a state event. It always begins after an event, where states may have jumped."""
        if self._solver is None:
            self._solver = self._make(time)
        self._solver.reset(time)
        event, _, reached = self._solver.step(time, goal)
        self._clock[ports.REACHED], self._clock[ports.STATE_EVENT] = reached, event


class _ModelExchange(Slave):
    """Steps from event to event; between them it is solved if there is something to solve."""

    _solver: Solver | None = None
    """Kept alive while compiled code has its address."""

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        port = super().port(inputs, outputs)
        states, indicators = self._sizes()
        if not (states or indicators):
            return port
        arguments = {
            "nx": states,
            "nz": indicators,
            "get_x": self._fmu.getContinuousStates,
            "set_x": self._fmu.setContinuousStates,
            "get_dx": self._derivatives(),
            "get_z": self._fmu.getEventIndicators,
            "get_nominals": self._fmu.getNominalsOfContinuousStates,
            "set_time": self._fmu.setTime,
            "input": _NoInput(),
            "relativeTolerance": RELATIVE_TOLERANCE,
        }
        self._solver = Solver(self._fmu, port.clock, lambda start: CVodeSolver(startTime=start, **arguments))
        return port._replace(do_step=self._solver.address)

    @abstractmethod
    def _sizes(self) -> tuple[int, int]:
        """Number of continuous states and of event indicators of the instance."""

    @abstractmethod
    def _derivatives(self) -> Callable[..., Any]:
        """The FMPy method that gets the derivatives of the states."""

    def _step_address(self) -> int:
        return 0

    def _addresses(self, prefix: str, names: tuple[str, ...], completed: bool) -> np.ndarray:
        addresses = [self.address(f"{prefix}{name}") for name in names]
        return np.array([*addresses, self.address(f"{prefix}CompletedIntegratorStep") if completed else 0])


class Fmi2ModelExchange(_ModelExchange, Fmi2):
    """An FMI 2.0 Model Exchange FMU."""

    stepping = ports.EVENTS
    calls = {**Fmi2.calls, "step": "fmi2NewDiscreteStates"}

    def _load(self) -> Any:
        return FMU2Model(
            guid=self.archive.description.guid,
            modelIdentifier=self.archive.description.modelExchange.modelIdentifier,
            unzipDirectory=str(self.archive.folder),
        )

    def _sizes(self) -> tuple[int, int]:
        description = self.archive.description
        return description.numberOfContinuousStates, description.numberOfEventIndicators

    def _derivatives(self) -> Callable[..., Any]:
        method: Callable[..., Any] = self._fmu.getDerivatives
        return method

    def _functions(self) -> np.ndarray:
        return self._addresses(
            "fmi2",
            ("SetTime", "EnterEventMode", "NewDiscreteStates", "EnterContinuousTimeMode"),
            self.archive.description.modelExchange.needsCompletedIntegratorStep,
        )


class Fmi3ModelExchange(_ModelExchange, Fmi3):
    """An FMI 3.0 Model Exchange FMU."""

    stepping = ports.EVENTS_3
    calls = {**Fmi3.calls, "step": "fmi3UpdateDiscreteStates"}

    def _load(self) -> Any:
        return FMU3Model(**self._arguments(self.archive.description.modelExchange.modelIdentifier))

    def _sizes(self) -> tuple[int, int]:
        return self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators()

    def _derivatives(self) -> Callable[..., Any]:
        method: Callable[..., Any] = self._fmu.getContinuousStateDerivatives
        return method

    def _functions(self) -> np.ndarray:
        return self._addresses(
            "fmi3",
            ("SetTime", "EnterEventMode", "UpdateDiscreteStates", "EnterContinuousTimeMode"),
            self.archive.description.modelExchange.needsCompletedIntegratorStep,
        )
