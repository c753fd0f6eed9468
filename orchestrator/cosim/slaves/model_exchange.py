"""Model Exchange controllers of FMI 2.0 and 3.0.

Without continuous states and event indicators (a sampled controller with time events) the compiled loop steps them by
itself. Any other is stepped by CVode, through callbacks into Python: 20 to 30 times slower, but it is the solver's
work.
"""

from __future__ import annotations

import ctypes
import math
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
"""Of the solver; a sample is so short that a tighter one hardly costs steps."""

STEP_CALLBACK = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
ERROR = 3


class _NoInput:
    """Inputs are set by the master and held; the solver has none to apply."""

    def apply(self, time: float) -> None:
        """Do nothing."""


class Stepper:
    """Steps a Model Exchange FMU with continuous states or event indicators by CVode."""

    def __init__(self, fmu: Any, states: int, indicators: int, derivatives: Callable[..., Any]) -> None:
        self._fmu = fmu
        self._next_event = math.inf
        self._handle_event(initial=True)
        self._solver = CVodeSolver(
            nx=states,
            nz=indicators,
            get_x=fmu.getContinuousStates,
            set_x=fmu.setContinuousStates,
            get_dx=derivatives,
            get_z=fmu.getEventIndicators,
            get_nominals=fmu.getNominalsOfContinuousStates,
            set_time=fmu.setTime,
            input=_NoInput(),
            startTime=0.0,
            relativeTolerance=RELATIVE_TOLERANCE,
        )
        self.callback = STEP_CALLBACK(self._guarded)

    def _guarded(self, _instance: int, time: float, step: float, _flag: int) -> int:
        # An exception that leaves a callback becomes 0 = OK for its caller in C.
        try:
            self._advance(time, time + step, 1e-6 * step)
        except Exception as problem:
            log.note(self._fmu.instanceName.encode(), ERROR, f"stepping by CVode failed: {problem}".encode())
            return ERROR
        return 0

    def _advance(self, time: float, end: float, tolerance: float) -> None:
        if self._next_event <= time + tolerance:
            self._fmu.setTime(time)
            self._handle_event()
        self._solver.reset(time)  # the inputs have jumped
        while time < end - tolerance:
            goal = min(end, self._next_event)
            state_event, _, time = self._solver.step(time, goal)
            self._fmu.setTime(time)
            wanted, terminate = self._fmu.completedIntegratorStep()
            if terminate:
                raise RuntimeError(f"the FMU ended the simulation at t = {time:g} s")
            if state_event or wanted or (self._next_event <= time + tolerance and time < end - tolerance):
                self._handle_event()
                self._solver.reset(time)

    def _handle_event(self, initial: bool = False) -> None:
        if not initial:
            self._fmu.enterEventMode()
        update = (
            self._fmu.newDiscreteStates if hasattr(self._fmu, "newDiscreteStates") else self._fmu.updateDiscreteStates
        )
        for _ in range(ports.MOST_ITERATIONS):
            again, terminate, _, _, defined, next_event = update()
            if terminate:
                raise RuntimeError("the FMU ended the simulation in an event")
            if not again:
                self._next_event = next_event if defined else math.inf
                self._fmu.enterContinuousTimeMode()
                return
        raise RuntimeError(f"event iteration has not ended after {ports.MOST_ITERATIONS} rounds")


class _ModelExchange(Slave):
    """Chooses between the compiled loop's own stepping and the solver."""

    _stepper: Stepper | None = None

    def port(self, inputs: Sequence[Variable], outputs: Sequence[Variable]) -> Port:
        states, indicators = self._sizes()
        if states or indicators:
            with self._reported("the first event iteration"):
                self._stepper = Stepper(self._fmu, states, indicators, self._derivatives())
            return super().port(inputs, outputs)._replace(stepping=ports.CO_SIMULATION)
        return super().port(inputs, outputs)

    @abstractmethod
    def _sizes(self) -> tuple[int, int]:
        """Number of continuous states and of event indicators of the instance."""

    @abstractmethod
    def _derivatives(self) -> Callable[..., Any]:
        """The FMPy method that gets the derivatives of the states."""

    def _step_address(self) -> int:
        if self._stepper is None:
            return 0
        return ctypes.cast(self._stepper.callback, ctypes.c_void_p).value or 0

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
        return self._fmu.getDerivatives

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
        return self._fmu.getContinuousStateDerivatives

    def _functions(self) -> np.ndarray:
        return self._addresses(
            "fmi3",
            ("SetTime", "EnterEventMode", "UpdateDiscreteStates", "EnterContinuousTimeMode"),
            self.archive.description.modelExchange.needsCompletedIntegratorStep,
        )
