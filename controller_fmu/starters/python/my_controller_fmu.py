"""A controller in Python: a PID for each axis. Replace the class Axis by your own."""

from collections import deque
from typing import Any

from pythonfmu import Boolean, DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Integer, Real
from pythonfmu.enums import Fmi2Status

T_S = 0.25e-3  # sample time [s]

UNITS = {
    "q_m_ref": "rad",
    "q_m": "rad",
    "u_m": "N.m",
    "u_m0": "N.m",
    "K_p": "N.m/rad",
    "K_i": "N.m/(rad.s)",
    "K_d": "N.m.s/rad",
}  # of every real variable, by its name without index

NO_FILTER, FIRST_ORDER = 1, 2
ENUMERATIONS = {"derivative_filter": ("none", "first_order")}  # integers whose values, from 1 on, have names


class Axis:
    """The controller of one axis, which starts from the torque [N.m] of the steady state.

    The derivative is the slope over some samples, behind a filter or not; the integrator can be off.
    """

    def __init__(self, gains: tuple[float, float, float], torque: float, my: "MyController") -> None:
        self.K_p, self.K_i, self.K_d = gains
        self.integrator = my.integrator
        self.z_p = 0.95 if my.derivative_filter == FIRST_ORDER else 0.0  # pole of the filter
        self.past = deque([0.0] * my.derivative_samples, my.derivative_samples)  # errors, the oldest one first
        self.v, self.s = 0.0, torque

    def sample(self, e: float) -> float:
        """Return the torque [N.m] for the position error ``e`` [rad]; called once every T_S."""
        self.v = self.z_p * self.v + (1.0 - self.z_p) * (e - self.past[0]) / (len(self.past) * T_S)
        if self.integrator:
            self.s = self.s + self.K_i * T_S * e
        self.past.append(e)
        return self.K_p * e + self.K_d * self.v + self.s


class MyController(Fmi2Slave):
    """What the benchmark connects, q_m_ref, q_m, u_m and u_m0, and gains to tune; each is a list of two.

    A Boolean, an enumeration and an integer say how: each is one for both axes.
    """

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size=T_S)
        self.start_time = 0.0
        self.stop_time: float | None = None
        self.q_m_ref, self.q_m = self.variable("q_m_ref", "input"), self.variable("q_m", "input")
        self.u_m = self.variable("u_m", "output")
        self.u_m0 = self.variable("u_m0", "parameter")
        self.K_p = self.variable("K_p", "parameter", 45.0, 15.0)
        self.K_i = self.variable("K_i", "parameter", 30.0, 10.0)
        self.K_d = self.variable("K_d", "parameter", 1.5, 0.5)
        self.integrator, self.derivative_filter, self.derivative_samples = True, FIRST_ORDER, 1
        fixed = {"causality": Fmi2Causality.parameter, "variability": Fmi2Variability.fixed}
        self.register_variable(Boolean("integrator", **fixed))
        self.register_variable(Integer("derivative_filter", **fixed))
        self.register_variable(Integer("derivative_samples", **fixed))

    def variable(self, name: str, causality: str, *start: float) -> list[float]:
        """Register ``name[1]`` and ``name[2]``, and return the list that holds their values."""
        values = list(start or (0.0, 0.0))
        variability = Fmi2Variability.fixed if causality == "parameter" else Fmi2Variability.continuous
        for i in (0, 1):
            self.register_variable(
                Real(
                    f"{name}[{i + 1}]",
                    causality=Fmi2Causality[causality],
                    variability=variability,
                    getter=lambda i=i: values[i],
                    setter=lambda value, i=i: values.__setitem__(i, value),
                )
            )
        return values

    def setup_experiment(self, start_time: float, stop_time: float | None, tolerance: float | None) -> None:
        """Remember when the first sample is due, and the stop time where one is told [s]."""
        self.start_time, self.stop_time = start_time, stop_time

    def exit_initialization_mode(self) -> None:
        """Start from the steady state; parameters have their values by now, in __init__ they have not."""
        if self.derivative_samples < 1:
            raise ValueError(f"derivative_samples = {self.derivative_samples} is refused: it must be 1 or more")
        self.axes = [Axis((self.K_p[i], self.K_i[i], self.K_d[i]), self.u_m0[i], self) for i in (0, 1)]
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
        for i in (0, 1):
            self.u_m[i] = self.axes[i].sample(self.q_m_ref[i] - self.q_m[i])
        self.samples += 1
        return True
