"""Model Exchange controllers of FMI 2.0 and 3.0.

The compiled loop takes them from event to event, see :mod:`orchestrator.fmi.port`. If there are continuous states or
event indicators, CVode works in between, through callbacks into Python: 20 to 30 times slower than a controller that is
only sampled, but that is the solver's work.
"""

from __future__ import annotations

import ctypes
import math
from abc import abstractmethod
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
from fmpy.fmi1 import FMICallException
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
DISCARD, ERROR = 2, 3

SMALLER_STEP, GIVE_UP = 1, -1
"""What a callback of CVode returns for values that it does not have: try again from nearer by, or end."""


class _NoInput:
    """Inputs are set by the master and held; the solver has none to apply."""

    def apply(self, time: float) -> None:
        """Do nothing."""


class _CVode(CVodeSolver):  # type: ignore[misc]
    """CVode, which is told when a call fails.

    An exception that leaves a callback is lost, and CVode takes what lies in memory for the callback's answer: some
    simulations went on with derivatives that the FMU had refused, others ended.
    """

    def f(self, *arguments: Any) -> int:
        """The derivatives."""
        return _answer(super().f, arguments)

    def g(self, *arguments: Any) -> int:
        """The event indicators."""
        return _answer(super().g, arguments)


def _answer(evaluate: Callable[..., int], arguments: Sequence[Any]) -> int:
    try:
        return evaluate(*arguments)
    except Exception as problem:
        # FMI 2.0 (2.1.3): after discard the solver may try a smaller step.
        return SMALLER_STEP if _is_discard(problem) else GIVE_UP


def _is_discard(problem: Exception) -> bool:
    return isinstance(problem, FMICallException) and problem.status == DISCARD


def _numbers(get: Callable[[Any, int], Any]) -> Callable[[Any, int], None]:
    """``get``, which has to write a number into each place of the values that it is given."""

    def call(values: Any, size: int) -> None:
        for i in range(size):
            values[i] = math.nan
        get(values, size)
        # CVode compares the signs of event indicators: of one that is not a number it would never see an event.
        if any(map(math.isnan, values[:size])):
            raise ValueError(f"{get.__name__} gave no number")

    return call


class Solver:
    """CVode for a Model Exchange FMU with continuous states or event indicators, called from the compiled loop."""

    def __init__(self, fmu: Any, clock: np.ndarray, functions: dict[str, Callable[..., Any]], **sizes: int) -> None:
        """``clock`` is the port's; ``functions`` and ``sizes`` are what CVode asks the FMU for, by FMPy's names."""
        self._fmu, self._clock = fmu, clock
        self._arguments = {name: self._checked(function) for name, function in functions.items()} | sizes
        self._solver: CVodeSolver | None = None
        self._failure: Exception | None = None
        self._callback = STEP_CALLBACK(self._guarded)

    def _checked(self, function: Callable[..., Any]) -> Callable[..., Any]:
        """``function``, which is not called after one has failed: FMPy's solver writes the states after CVode's end."""

        def call(*arguments: Any) -> Any:
            if self._failure is not None:
                raise self._failure
            try:
                return function(*arguments)
            except Exception as problem:
                self._failure = None if _is_discard(problem) else problem
                raise

        return call

    @property
    def address(self) -> int:
        """The address of a C function with the arguments of fmi2DoStep."""
        return ctypes.cast(self._callback, ctypes.c_void_p).value or 0

    def _guarded(self, _instance: int, time: float, step: float, _flag: int) -> int:
        # An exception that leaves a callback becomes 0 = OK for its caller in C.
        try:
            self._integrate(time, time + step)
        except Exception as problem:
            told = self._failure or problem
            log.current.keep(f"solving by CVode failed: {told}".encode(), self._fmu.instanceName.encode())
            return ports.FATAL if getattr(told, "status", None) == ports.FATAL else ERROR
        return 0

    def _integrate(self, time: float, goal: float) -> None:
        """Up to ``goal`` [s] or a state event. It always begins after an event, where states may have jumped."""
        # Not earlier: CVode reads states and nominals, which an FMU has after its initialization.
        if self._solver is None:
            self._solver = _CVode(
                startTime=time, input=_NoInput(), relativeTolerance=RELATIVE_TOLERANCE, **self._arguments
            )
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
        functions = {
            "get_x": self._fmu.getContinuousStates,
            "set_x": self._fmu.setContinuousStates,
            "get_dx": _numbers(getattr(self._fmu, self._derivatives)),
            "get_z": _numbers(self._fmu.getEventIndicators),
            "get_nominals": self._fmu.getNominalsOfContinuousStates,
            "set_time": self._fmu.setTime,
        }
        self._solver = Solver(self._fmu, port.clock, functions, nx=states, nz=indicators)
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
