"""A linear controller with the drive's limits as an FMI 2.0 co-simulation slave, where there is no C compiler.

The law, its schedule and its variables are those of ``model.c`` beside this module, which is a hundred times faster;
the data are ``state_space.json`` in the FMU's resources.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

UNITS = {"q_m_ref": "rad", "q_m": "rad", "u_m": "N.m", "u_m0": "N.m"}
KINDS = {"q_m_ref": "input", "q_m": "input", "u_m": "output", "u_m0": "parameter"}
VARIABILITY = {"input": "continuous", "output": "discrete", "parameter": "fixed"}
Q_M_REF, Q_M, U_M, U_M0 = 0, 2, 4, 6
"""Value references of the connectors."""
STEP_TOLERANCE = 1e-9
CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": False,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
}


class StateSpace(Fmi2Slave):
    """The slave; its variables are one list indexed by value reference."""

    description = "Linear controller: u_m = u_m0 + C x + D (q_m_ref - q_m)"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        data = json.loads(Path(__file__).with_name("state_space.json").read_text(encoding="utf-8"))
        self.T_s, self.limit, self.cells, self.is_linear = (data[k] for k in ("T_s", "limit", "cells", "is_linear"))
        self.points, self.laws, self.backs = (np.array(data[name]) for name in ("points", "laws", "backs"))
        self.default_experiment = DefaultExperiment(step_size=self.T_s)
        self.values = [0.0] * 8
        self.law, self.back, self.z = self.laws[0], self.backs[0], np.zeros(len(self.laws[0]))
        self.initialized = False
        for name, causality in KINDS.items():
            for axis in (1, 2):
                kind = {"causality": Fmi2Causality[causality], "variability": Fmi2Variability[VARIABILITY[causality]]}
                self.register_variable(Real(f"{name}[{axis}]", **kind))

    def to_xml(self, model_options: dict[str, Any] | None = None) -> Any:
        """The model description with true capabilities."""
        return super().to_xml({**CAPABILITIES, **(model_options or {})})

    def get_real(self, vrs: list[int]) -> list[float]:
        """The variables with the value references ``vrs``."""
        return [self.values[vr] for vr in vrs]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set the variables with the value references ``vrs``."""
        for vr, value in zip(vrs, values):  # noqa: B905 - a strict zip costs 0.1 us a call
            self.values[vr] = value
        if not self.initialized:  # until initialization has ended, the outputs follow the parameter u_m0
            self.values[U_M : U_M + 2] = self.values[U_M0 : U_M0 + 2]

    def exit_initialization_mode(self) -> None:
        """Make the law for the reference of those for the points of the schedule."""
        q = self.values[Q_M_REF : Q_M_REF + 2]
        weights = self._interpolated(q) if self.is_linear else [(1.0, int(np.argmin(((self.points - q) ** 2).sum(1))))]
        self.law = sum(weight * self.laws[point] for weight, point in weights)
        self.back = sum(weight * self.backs[point] for weight, point in weights)
        self.initialized = True

    def _interpolated(self, q: list[float]) -> list[tuple[float, int]]:
        """Weights of points. The triangle whose smallest weight is largest contains ``q``, if any does; beyond them
        all, weights are cut off at 0."""
        best, found = -math.inf, []
        for cell in self.cells:
            first, second = (q[i] - cell["origin"][i] for i in (0, 1))
            w = [row[0] * first + row[1] * second for row in cell["inverse"]]
            w.append(1.0 - w[0] - w[1])
            if min(w) > best:
                best, found = min(w), list(zip(w, cell["corner"], strict=True))
        total = sum(max(weight, 0.0) for weight, _ in found)
        return [(max(weight, 0.0) / total, point) for weight, point in found]

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Sample the inputs once; refuse (False, with a log message) a step other than T_s."""
        if not abs(step_size - self.T_s) <= STEP_TOLERANCE * self.T_s:
            self.log(
                f"{self.instance_name}: step of {step_size!r} s at t = {current_time!r} s refused: the "
                f"communication step must equal the sample time T_s = {self.T_s!r} s",
                Fmi2Status.error,
            )
            return False
        values, z = self.values, self.z
        z[-2] = values[Q_M_REF] - values[Q_M]
        z[-1] = values[Q_M_REF + 1] - values[Q_M + 1]
        z = self.law @ z
        if not all(map(math.isfinite, z[-2:])):
            self.log(
                f"{self.instance_name}: u_m - u_m0 = {z[-2:].tolist()} N.m at t = {current_time!r} s refused: with "
                f"q_m_ref = {values[Q_M_REF : Q_M_REF + 2]} and q_m = {values[Q_M : Q_M + 2]} rad it is not finite",
                Fmi2Status.error,
            )
            return False
        self.z = z
        for i, v in enumerate(z[-2:].tolist()):
            wanted, limit = values[U_M0 + i] + v, self.limit[i]
            values[U_M + i] = wanted
            if abs(wanted) > limit:
                values[U_M + i] = math.copysign(limit, wanted)
                z += self.back[:, i] * (values[U_M + i] - wanted)
        return True

    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "values": list(self.values),
            "z": self.z.tolist(),
            "law": self.law.tolist(),
            "back": self.back.tolist(),
            "initialized": self.initialized,
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self.values, self.initialized = list(state["values"]), state["initialized"]
        self.z, self.law, self.back = (np.array(state[name]) for name in ("z", "law", "back"))
