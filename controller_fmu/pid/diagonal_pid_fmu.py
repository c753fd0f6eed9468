"""The benchmark's default controller, eq. (12)-(13), as an FMI 2.0 co-simulation slave.

The law of one axis, for the error e_k = q_m_ref - q_m at sample k, is eq. (13) written as a recursion:

    v_k = z_p v_{k-1} + (1 - z_p) (e_k - e_{k-1}) / T_s        filtered derivative [rad/s]
    s_k = s_{k-1} + K_i T_s e_k                                integrator [N.m]
    u_k = K_p e_k + K_d v_k + s_k                              torque command [N.m]

with e_{-1} = v_{-1} = 0 and s_{-1} = u_m0. Eq. (12) has nothing off its diagonal: the axes are independent.

Timing: the slave samples its inputs at the start of a communication step, so the outputs after doStep k
belong to the inputs set before it. One step is one sample; a step of any other length than T_s is refused, but the last
one may be shorter, and one of next to nothing is no sample (``DiagonalPID.is_sample``).

The module is alone in its FMU and carries an unmistakable name, because all FMUs that bring Python code share
one interpreter in a simulation: of two modules with one name only one would be loaded.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple
from xml.etree.ElementTree import Element

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real
from pythonfmu.enums import Fmi2Status

AxisState = tuple[float, float, float]
"""What one axis remembers from its last sample: error e [rad], derivative v [rad/s], integrator s [N.m]."""

UNITS = {
    "q_m_ref": "rad",
    "q_m": "rad",
    "u_m": "N.m",
    "K_p": "N.m/rad",
    "K_i": "N.m/(rad.s)",
    "K_d": "N.m.s/rad",
    "z_p": "1",
    "T_s": "s",
    "u_m0": "N.m",
}
"""Unit of every variable, by its name without index; the build writes them into the model description."""

CAPABILITIES = {
    "canHandleVariableCommunicationStepSize": False,
    "canGetAndSetFMUstate": True,
    "canSerializeFMUstate": True,
}

# Value references: both elements of an array stand side by side, T_s is the only scalar.
Q_M_REF, Q_M, U_M, K_P, K_I, K_D, Z_P, T_S, U_M0 = 0, 2, 4, 6, 8, 10, 12, 14, 15
AXES = (0, 1)

LEEWAY = 0.01
"""A time may be so far beside where it should be, in sample times: masters compute times in their own way. One that
sums up steps of 0.25 ms is so far off after 9,000 s."""

VARIABLES = (
    ("q_m_ref", "input", (0.0, 0.0), "Motor position reference"),
    ("q_m", "input", (0.0, 0.0), "Measured motor position"),
    ("u_m", "output", (0.0, 0.0), "Motor torque command"),
    ("K_p", "parameter", (45.0, 15.0), "Proportional gain"),
    ("K_i", "parameter", (30.0, 10.0), "Integral gain"),
    ("K_d", "parameter", (1.5, 0.5), "Derivative gain"),
    ("z_p", "parameter", (0.95, 0.95), "Pole of the derivative filter"),
    ("T_s", "parameter", (0.25e-3,), "Sample time; the communication step must equal it"),
    ("u_m0", "parameter", (0.0, 0.0), "Start value of the integrator, the torque before the first sample"),
)
"""Name, causality, start values and description in the order of the value references."""

VARIABILITY = {
    "input": Fmi2Variability.continuous,
    "output": Fmi2Variability.discrete,
    "parameter": Fmi2Variability.fixed,
}


class Gains(NamedTuple):
    """The constants of one axis in eq. (13)."""

    K_p: float
    """Proportional gain [N.m/rad]."""
    K_i: float
    """Integral gain [N.m/(rad.s)]."""
    K_d: float
    """Derivative gain [N.m.s/rad]."""
    z_p: float
    """Pole of the derivative filter [1], 0 <= z_p < 1."""
    T_s: float
    """Sample time [s], > 0."""


def sample(gains: Gains, state: AxisState, e: float) -> AxisState:
    """Return the state of one axis after a sample of the error ``e`` [rad]; see the module's recursion."""
    e_1, v_1, s_1 = state
    v = gains.z_p * v_1 + (1.0 - gains.z_p) * (e - e_1) / gains.T_s
    s = s_1 + gains.K_i * gains.T_s * e
    return e, v, s


def torque(gains: Gains, state: AxisState) -> float:
    """Return the torque command [N.m] that belongs to the state of one axis, eq. (13)."""
    e, v, s = state
    return gains.K_p * e + gains.K_d * v + s


def check_parameters(T_s: float, z_p: tuple[float, ...]) -> str | None:
    """Return what is wrong with the sample time [s] and the filter poles [1], or None if nothing is."""
    if not 0.0 < T_s < math.inf:
        return f"parameter T_s = {T_s!r} s: the sample time must be positive and finite"
    for axis, pole in enumerate(z_p, start=1):
        if not 0.0 <= pole < 1.0:
            return f"parameter z_p[{axis}] = {pole!r}: the filter pole must lie in 0 <= z_p < 1"
    return None


def check_finite(values: list[float]) -> str | None:
    """Return which input or parameter is not finite, or None if all are; ``values`` by value reference."""
    own = iter(values)
    for name, causality, start, _ in VARIABLES:
        for index in range(1, len(start) + 1):
            value = next(own)
            if causality != "output" and not math.isfinite(value):
                return f"{name}[{index}] = {value!r}: it must be finite"
    return None


class DiagonalPID(Fmi2Slave):  # pythonfmu carries no types
    """The slave; its variables are one list indexed by value reference, which halves the cost of a call."""

    author = "FlexibleManipulator benchmark contributors"
    license = "MIT"
    description = "Diagonal discrete-time PID controller with derivative filter, eq. (12)-(13) of the benchmark"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(start_time=0.0, stop_time=0.25, step_size=0.25e-3)
        self._values: list[float] = []
        self._gains: tuple[Gains, ...] = ()
        self._states: tuple[AxisState, ...] = ()
        self._start_time, self._samples = 0.0, 0
        self._stop_time: float | None = None
        for name, causality, start, text in VARIABLES:
            for index, value in enumerate(start, start=1):
                self._values.append(value)
                self.register_variable(
                    Real(
                        f"{name}[{index}]" if len(start) > 1 else name,
                        causality=Fmi2Causality[causality],
                        variability=VARIABILITY[causality],
                        description=text,
                    )
                )

    def to_xml(self, model_options: dict[str, Any] | None = None) -> Element:
        """Return the model description with this slave's true capabilities."""
        description: Element = super().to_xml({**CAPABILITIES, **(model_options or {})})
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
        if not self._gains:  # until initialization has ended, the outputs follow the parameter u_m0
            own[U_M : U_M + 2] = own[U_M0 : U_M0 + 2]

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Remember when the first sample is due, and the stop time where one is told [s]."""
        self._start_time, self._stop_time = start_time, stop_time

    def exit_initialization_mode(self) -> None:
        """Read the parameters once and for all.

        Raises:
            ValueError: a parameter has a value the law cannot work with; it is also logged.
        """
        x = self._values
        problem = check_parameters(x[T_S], tuple(x[Z_P : Z_P + 2])) or check_finite(x)
        if problem is not None:
            self.log(f"{self.instance_name}: {problem}", Fmi2Status.error)
            raise ValueError(problem)
        self._gains = tuple(Gains(x[K_P + i], x[K_I + i], x[K_D + i], x[Z_P + i], x[T_S]) for i in AXES)
        self._states = tuple((0.0, 0.0, x[U_M0 + i]) for i in AXES)
        self._samples = 0

    def is_sample(self, current_time: float, step_size: float) -> bool | None:
        """Return whether a step is a sample; None, with a log message, if it is refused.

        It is one if it begins at an instant of the grid start time + k T_s and ends at the next; the last step may end
        before. One that ends where it began is left over by a master's arithmetic, and no sample. Whatever else a
        master does, it is told before samples get another distance than T_s.
        """
        T_s, stop = self._gains[0].T_s, self._stop_time
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
        x = self._values
        gains_1, gains_2 = self._gains
        state_1, state_2 = self._states
        state_1 = sample(gains_1, state_1, x[Q_M_REF] - x[Q_M])
        state_2 = sample(gains_2, state_2, x[Q_M_REF + 1] - x[Q_M + 1])
        u_m1, u_m2 = torque(gains_1, state_1), torque(gains_2, state_2)
        if not u_m1 - u_m1 == 0.0 == u_m2 - u_m2:  # infinite or not a number; half the price of math.isfinite
            self.log(
                f"{self.instance_name}: u_m = {u_m1!r}, {u_m2!r} N.m at t = {current_time!r} s refused: with "
                f"q_m_ref = {x[Q_M_REF : Q_M_REF + 2]} and q_m = {x[Q_M : Q_M + 2]} rad the torque is not finite",
                Fmi2Status.error,
            )
            return False
        x[U_M], x[U_M + 1] = u_m1, u_m2
        self._states = state_1, state_2
        self._samples += 1
        return True

    def _get_fmu_state(self) -> dict[str, Any]:
        times = self._start_time, self._stop_time, self._samples
        return {"values": list(self._values), "gains": self._gains, "states": self._states, "times": times}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        # Tuples come back as lists where the state went through JSON.
        self._values = list(state["values"])
        self._gains = tuple(Gains(*gains) for gains in state["gains"])
        self._states = tuple((e, v, s) for e, v, s in state["states"])
        self._start_time, self._stop_time, self._samples = state["times"]
