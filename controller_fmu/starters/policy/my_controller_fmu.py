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

    def exit_initialization_mode(self) -> None:
        """Start from the steady state."""
        self.observation = Observation()
        self.u_m[:] = self.u_m0

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Sample the inputs once; a step of another length is refused."""
        if not abs(step_size - T_S) <= 1e-9 * T_S:
            self.log(f"step of {step_size!r} s refused: it must be the sample time {T_S} s", Fmi2Status.error)
            return False
        action = self.network(np.array(self.observation.sample(self.q_m_ref, self.q_m, step_size)))
        for i in (0, 1):
            self.u_m[i] = self.u_m0[i] + float(action[i])
        return True
