"""A policy as a controller: u_m = u_m0 + network(observation), with the network of the module beside it."""

from pathlib import Path
from typing import Any

import numpy as np
from manipulator_observation import Observation
from my_controller_network import load
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

T_S = 0.25e-3  # sample time [s]

UNITS = {"q_m_ref": "rad", "q_m": "rad", "u_m": "N.m", "u_m0": "N.m"}
CAUSALITY = {"q_m_ref": "input", "q_m": "input", "u_m": "output", "u_m0": "parameter"}


class MyController(Fmi2Slave):
    """What the benchmark connects: lists of two."""

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size=T_S)
        self.start_time = 0.0
        self.stop_time: float | None = None
        self.network = load(Path(__file__).parent)
        self.q_m_ref, self.q_m, self.u_m, self.u_m0 = (self.variable(name) for name in CAUSALITY)

    def variable(self, name: str) -> list[float]:
        """Register ``name[1]`` and ``name[2]``, and return the list that holds their values."""
        values, causality = [0.0, 0.0], Fmi2Causality[CAUSALITY[name]]
        is_parameter = causality == Fmi2Causality.parameter
        kind = {
            "causality": causality,
            "variability": Fmi2Variability.fixed if is_parameter else Fmi2Variability.continuous,
        }
        for i in (0, 1):
            access = {"getter": lambda i=i: values[i], "setter": lambda value, i=i: values.__setitem__(i, value)}
            self.register_variable(Real(f"{name}[{i + 1}]", **kind, **access))
        return values

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Remember when the first sample is due, and the stop time where one is told [s]."""
        self.start_time, self.stop_time = start_time, stop_time

    def exit_initialization_mode(self) -> None:
        """Start from the steady state."""
        self.observation = Observation()
        self.u_m[:] = self.u_m0
        self.samples = 0

    def is_sample(self, current_time: float, step_size: float) -> bool | None:
        """Whether a step is a sample, which lasts T_S; the last one may be shorter. None if the step is refused.

        A hundredth of T_S is for the arithmetic of masters: a step that is no longer is left over, and no sample.
        """
        begin, leeway = current_time - self.start_time - self.samples * T_S, 0.01 * T_S
        end = begin + step_size
        if abs(begin) <= leeway and step_size >= 0.0:
            if end <= leeway:
                return False
            may_be_last = self.stop_time is None or current_time + step_size >= self.stop_time - leeway
            if abs(end - T_S) <= leeway or (end < T_S and may_be_last):
                return True
        text = f"step of {step_size!r} s at t = {current_time!r} s refused: it must be the sample time {T_S} s"
        self.log(f"{text}, and only the last one may be shorter", Fmi2Status.error)
        return None

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Sample the inputs once if the step is a sample."""
        is_sample = self.is_sample(current_time, step_size)
        if not is_sample:
            return is_sample is not None
        action = self.network(np.array(self.observation.sample(self.q_m_ref, self.q_m, T_S)))
        for i in (0, 1):
            self.u_m[i] = self.u_m0[i] + float(action[i])
        self.samples += 1
        return True
