"""The two-axis PID as a pythonfmu3 slave whose variables are scalars, ``q_m[1]`` and ``q_m[2]``."""

from pythonfmu3 import DefaultExperiment, Float64, Fmi3Causality, Fmi3Slave, Fmi3StepResult, Fmi3Variability, Unit
from two_axis_pid_law import GAINS, T_S, Axis

CONNECTORS = (
    ("q_m_ref", Fmi3Causality.input, Fmi3Variability.continuous, "rad"),
    ("q_m", Fmi3Causality.input, Fmi3Variability.continuous, "rad"),
    ("u_m", Fmi3Causality.output, Fmi3Variability.discrete, "N.m"),
    ("u_m0", Fmi3Causality.parameter, Fmi3Variability.fixed, "N.m"),
)


class ScalarPID3(Fmi3Slave):
    """Values live in lists, one a connector; getters and setters reach into them."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size=T_S)
        self.register_units([Unit("rad", rad=1), Unit("N.m", kg=1, m=2, s=-2)])
        self.time = 0.0
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous)
        )
        self.values = {}
        for name, causality, variability, unit in CONNECTORS:
            values = self.values[name] = [0.0, 0.0]
            for index in (0, 1):
                self.register_variable(
                    Float64(
                        f"{name}[{index + 1}]",
                        causality=causality,
                        variability=variability,
                        unit=unit,
                        getter=lambda values=values, index=index: values[index],
                        setter=lambda value, values=values, index=index: values.__setitem__(index, value),
                    )
                )

    def exit_initialization_mode(self):
        self.values["u_m"][:] = self.values["u_m0"]
        self.axes = [Axis(gains, torque) for gains, torque in zip(GAINS, self.values["u_m0"], strict=True)]

    def do_step(self, current_time, step_size):
        values = self.values
        for i, axis in enumerate(self.axes):
            values["u_m"][i] = axis.sample(values["q_m_ref"][i] - values["q_m"][i])
        self.time = current_time + step_size
        return Fmi3StepResult()
