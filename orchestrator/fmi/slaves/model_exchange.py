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

from .. import log
from .. import port as ports
from ..port import Port
from ..variables import Variable
from .base import Slave
from .co_simulation import Fmi2, Fmi3

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
            log.current.keep(f"solving by CVode failed: {problem}".encode(), self._fmu.instanceName.encode())
            return ERROR
        return 0

    def _integrate(self, time: float, goal: float) -> None:
        """Up to ``goal`` [s] or a state event. It always begins after an event, where states may have jumped."""
        # Not earlier: CVode reads states and nominals, which an FMU has after its initialization.
        if self._solver is None:
            self._solver = self._make(time)
        self._solver.reset(time)
        event, _, reached = self._solver.step(time, goal)
        self._clock[ports.REACHED], self._clock[ports.STATE_EVENT] = reached, event


class _ModelExchange(Slave):
    """Steps from event to event; between them it is solved if there is something to solve."""

    _solver: Solver | None = None
    """Kept alive while compiled code has its address."""
    _derivatives: str
    """The FMPy method that gets the derivatives of the states."""

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        port = super().port(inputs, outputs)
        states, indicators = self._sizes()
        # A sampled controller: its values change in events alone, and no solver is needed between them.
        if not (states or indicators):
            return port
        arguments = {
            "nx": states,
            "nz": indicators,
            "get_x": self._fmu.getContinuousStates,
            "set_x": self._fmu.setContinuousStates,
            "get_dx": getattr(self._fmu, self._derivatives),
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

    def _step_address(self) -> int:
        return 0

    def _functions(self) -> np.ndarray:
        update = self.calls["step"]
        names = ["SetTime", "EnterEventMode", update[4:], "EnterContinuousTimeMode", "CompletedIntegratorStep"]
        addresses = [self.address(update[:4] + name) for name in names]
        # FMPy gives FMI 2.0's completedIntegratorStepNotNeeded, turned around, under this name of FMI 3.0.
        if not self.archive.interface.needsCompletedIntegratorStep:
            addresses[ports.COMPLETED] = 0
        return np.array(addresses)


class Fmi2ModelExchange(_ModelExchange, Fmi2):
    """An FMI 2.0 Model Exchange FMU."""

    fmpy_class = FMU2Model
    stepping = ports.EVENTS
    calls = {**Fmi2.calls, "step": "fmi2NewDiscreteStates"}
    _derivatives = "getDerivatives"

    def _sizes(self) -> tuple[int, int]:
        description = self.archive.description
        return description.numberOfContinuousStates, description.numberOfEventIndicators


class Fmi3ModelExchange(_ModelExchange, Fmi3):
    """An FMI 3.0 Model Exchange FMU."""

    fmpy_class = FMU3Model
    stepping = ports.EVENTS_3
    calls = {**Fmi3.calls, "step": "fmi3UpdateDiscreteStates"}
    _derivatives = "getContinuousStateDerivatives"

    def _sizes(self) -> tuple[int, int]:
        return self._fmu.getNumberOfContinuousStates(), self._fmu.getNumberOfEventIndicators()
