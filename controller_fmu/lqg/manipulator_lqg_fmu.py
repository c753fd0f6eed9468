"""The scheduled LQG controller as an FMI 2.0 co-simulation slave.

The design (flexible_manipulator_lqg) runs at the end of initialization, with the weights that the parameters then have
and for the pose that q_m_ref and u_m0 tell. A step is one product of a matrix and a vector:

    (z+, u+, tool error) = law (z, u, e)

with the filter's state z, the torque u about u_m0 [N.m], the measured deviation e = q_m - q_m_ref [rad], and the
estimate of the TCP's error [m], which nobody needs here; ``controller_fmu/friction`` does.

Timing: the slave samples its inputs at the start of a communication step, so the outputs after doStep k
belong to the inputs set before it. One step is one sample; a step of any other length than T_s is refused, but the last
one may be shorter, and one of next to nothing is no sample (``ManipulatorLQG.is_sample``).

Modules in FMUs carry unmistakable names, because all FMUs that bring Python code share one interpreter in a
simulation: of two modules with one name only one would be loaded.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar
from xml.etree.ElementTree import Element

import numpy as np
from flexible_manipulator_lqg import design as lqg
from flexible_manipulator_lqg.interface import BASE_UNITS, CONNECTORS, SAMPLE_TIME, Weights, chosen, parameters
from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

__all__ = ["BASE_UNITS", "UNITS", "ManipulatorLQG"]

ROWS = (*CONNECTORS, *parameters(Weights))
"""The variables in the order of their value references."""

UNITS = {row.name: row.unit for row in ROWS}
"""Unit of every variable, by its name without index; the build writes them into the model description."""

CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": False,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
}

# Value references of the connectors.
Q_M_REF, Q_M, U_M, T_S, U_M0 = 0, 2, 4, 6, 7
U, E = lqg.STATES, lqg.STATES + 2
"""Where torques and deviations (afterwards, the estimated TCP error) stand in the law's vectors."""
LEEWAY = 0.01
"""A time may be so far beside where it should be, in sample times: masters compute times in their own way. One that
sums up steps of 0.25 ms is so far off after 9,000 s."""

VARIABILITY = {
    "input": Fmi2Variability.continuous,
    "output": Fmi2Variability.discrete,
    "parameter": Fmi2Variability.fixed,
}


class ManipulatorLQG(Fmi2Slave):  # pythonfmu carries no types
    """The slave; its variables are one list indexed by value reference, which halves the cost of a call."""

    author = "FlexibleManipulator benchmark contributors"
    license = "MIT"
    description = "LQG controller for the flexible manipulator, designed at initialization for the reference position"
    data: ClassVar[Path] = Path(__file__).with_name("lqg_weights.json")
    """The parameters' start values, beside the script in the FMU's resources."""
    rows = ROWS

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=0.25, step_size=0.25e-3)
        self._values: list[float] = []
        self._law = np.zeros((lqg.LAW_SIZE, lqg.LAW_SIZE))
        self._initialized = False
        self._u_0 = (0.0, 0.0)
        self._T_s = 0.0
        self._start_time, self._samples = 0.0, 0
        self._stop_time: float | None = None
        # What went in and what came out; a step exchanges the two.
        self._now, self._next = np.zeros(lqg.LAW_SIZE), np.zeros(lqg.LAW_SIZE)
        starts = {"T_s": SAMPLE_TIME, **json.loads(self.data.read_text(encoding="utf-8"))["parameters"]}
        for row in self.rows:
            for name in row.names:
                self._values.append(starts.get(name, 0.0))
                self.register_variable(
                    Real(
                        name,
                        causality=Fmi2Causality[row.causality],
                        variability=VARIABILITY[row.causality],
                        description=row.description,
                    )
                )

    def to_xml(self, model_options: dict[str, Any] | None = None) -> Element:
        """Return the model description with true capabilities, exact start values and the parameters' ranges."""
        description: Element = super().to_xml({**CAPABILITIES, **(model_options or {})})
        # pythonfmu writes 16 digits, which are not always enough.
        least = [row.least for row in self.rows for _ in row.names]
        for real, start, lowest in zip(description.iter("Real"), self._values, least, strict=True):
            if "start" in real.attrib:
                real.set("start", repr(start))
            if lowest is not None:
                real.set("min", repr(lowest))
        return description

    def get_real(self, vrs: list[int]) -> list[float]:
        """Return the variables with the value references ``vrs``."""
        values = self._values
        return [values[vr] for vr in vrs]

    def set_real(self, vrs: list[int], values: list[float]) -> None:
        """Set the variables with the value references ``vrs``."""
        own = self._values
        for vr, value in zip(vrs, values):  # noqa: B905 - a strict zip costs 0.1 us a call
            own[vr] = value
        if not self._initialized:  # until initialization has ended, the outputs follow the parameter u_m0
            own[U_M : U_M + 2] = own[U_M0 : U_M0 + 2]

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Remember when the first sample is due, and the stop time where one is told [s]."""
        self._start_time, self._stop_time = start_time, stop_time

    def exit_initialization_mode(self) -> None:
        """Read the parameters once and for all, and design the controller for the reference position.

        Raises:
            ValueError: a parameter has a value the design cannot work with; it is also logged.
        """
        x = self._values
        try:
            if not 0.0 < x[T_S] < math.inf:
                raise ValueError(f"parameter T_s = {x[T_S]!r} s: the sample time must be positive and finite")
            values = dict(zip((name for row in self.rows for name in row.names), x, strict=True))
            for name in ("q_m_ref[1]", "q_m_ref[2]", "u_m0[1]", "u_m0[2]"):  # the others have ranges
                if not math.isfinite(values[name]):
                    raise ValueError(f"{name} = {values[name]!r}: it must be finite")
            self._design(values)
        except (ValueError, ArithmeticError) as problem:
            self.log(f"{self.instance_name}: {problem}", Fmi2Status.error)
            raise
        self._initialized = True
        self._T_s = x[T_S]
        self._u_0 = (x[U_M0], x[U_M0 + 1])
        self._samples = 0

    def _design(self, values: Mapping[str, float]) -> None:
        """Make the controller of the variables' values, by name."""
        x = self._values
        pose = lqg.pose((x[Q_M_REF], x[Q_M_REF + 1]), (x[U_M0], x[U_M0 + 1]))
        self._law = lqg.law(lqg.controller(chosen(Weights, values), pose, x[T_S]))

    def is_sample(self, current_time: float, step_size: float) -> bool | None:
        """Return whether a step is a sample; None, with a log message, if it is refused.

        It is one if it begins at an instant of the grid start time + k T_s and ends at the next; the last step may end
        before. One that ends where it began is left over by a master's arithmetic, and no sample. Whatever else a
        master does, it is told before samples get another distance than T_s.
        """
        T_s, stop = self._T_s, self._stop_time
        due = self._start_time + self._samples * T_s
        begin, leeway = current_time - due, LEEWAY * T_s
        end = begin + step_size
        if abs(begin) <= leeway and step_size >= 0.0:
            if end <= leeway:
                return False
            # Not all masters tell the stop time: without it, any step may be the last.
            if abs(end - T_s) <= leeway or (end < T_s and (stop is None or current_time + step_size >= stop - leeway)):
                return True
        self.log(
            f"{self.instance_name}: step of {step_size!r} s at t = {current_time!r} s refused: "
            + (
                f"the communication step must equal the sample time T_s = {T_s!r} s"
                if abs(begin) <= leeway
                else f"the next sample is due at t = {due!r} s; only the last step may be shorter than the sample time"
            ),
            Fmi2Status.error,
        )
        return None

    def do_step(self, current_time: float, step_size: float) -> bool:
        """Sample the inputs once if the step is a sample; refuse (False, with a log message) as :meth:`is_sample`."""
        is_sample = self.is_sample(current_time, step_size)
        if not is_sample:
            return is_sample is not None
        is_done = self._sample(current_time)
        self._samples += is_done
        return is_done

    def _sample(self, current_time: float) -> bool:
        """Compute the torques of the next sample; False, with a log message, if they are not finite."""
        x, now, after = self._values, self._now, self._next
        now[E] = x[Q_M] - x[Q_M_REF]
        now[E + 1] = x[Q_M + 1] - x[Q_M_REF + 1]
        np.dot(self._law, now, after)
        u_m = self._u_0[0] + after.item(U), self._u_0[1] + after.item(U + 1)
        if not u_m[0] - u_m[0] == 0.0 == u_m[1] - u_m[1]:  # infinite or not a number
            self.log(
                f"{self.instance_name}: u_m = {u_m} N.m at t = {current_time!r} s refused: with q_m_ref = "
                f"{x[Q_M_REF : Q_M_REF + 2]} and q_m = {x[Q_M : Q_M + 2]} rad the torque is not finite",
                Fmi2Status.error,
            )
            return False
        self._now, self._next = after, now
        x[U_M : U_M + 2] = u_m
        return True

    def _get_fmu_state(self) -> dict[str, Any]:
        return {
            "values": list(self._values),
            "initialized": self._initialized,
            "law": self._law.tolist(),
            "now": self._now.tolist(),
            "T_s": self._T_s,
            "u_0": self._u_0,
            "times": (self._start_time, self._stop_time, self._samples),
        }

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        self._values = list(state["values"])
        self._initialized = state["initialized"]
        self._law = np.array(state["law"])
        self._now = np.array(state["now"])
        self._T_s = state["T_s"]
        self._u_0 = tuple(state["u_0"])
        self._start_time, self._stop_time, self._samples = state["times"]
