"""The two-axis PID as a pythonfmu3 slave whose variables are scalars, ``q_m[1]``, or FMI 3.0 arrays of two.

The arrays' setters are its own: those of pythonfmu3 0.3.4 call ``np.reshape(newshape=...)``, which NumPy 2.4 dropped.
"""

from functools import partial

from pythonfmu3 import DefaultExperiment, Dimension, Float64, Fmi3Causality, Fmi3Slave, Fmi3StepResult, Fmi3Variability
from pythonfmu3 import Unit as Units
from two_axis_pid_law import GAINS, T_S, Axis

ARRAYS = False
CONNECTORS = (
    ("q_m_ref", Fmi3Causality.input, Fmi3Variability.continuous, "rad"),
    ("q_m", Fmi3Causality.input, Fmi3Variability.continuous, "rad"),
    ("u_m", Fmi3Causality.output, Fmi3Variability.discrete, "N.m"),
    ("u_m0", Fmi3Causality.parameter, Fmi3Variability.fixed, "N.m"),
)


class PID3(Fmi3Slave):
    """Values live in lists, one a connector; getters and setters reach into them."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size=T_S)
        self.register_units([Units("rad", rad=1), Units("N.m", kg=1, m=2, s=-2)])
        self.time = 0.0
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous)
        )
        self.values = {}
        for name, causality, variability, unit in CONNECTORS:
            self.values[name] = [0.0, 0.0]
            for key, spelled in [(name, name)] if ARRAYS else [((name, 0), f"{name}[1]"), ((name, 1), f"{name}[2]")]:
                more = {"dimensions": [Dimension(start="2")]} if ARRAYS else {"unit": unit}
                more |= {"getter": partial(self.read, key), "setter": partial(self.write, key)}
                self.register_variable(Float64(spelled, causality=causality, variability=variability, **more))

    def read(self, key):
        return self.values[key] if ARRAYS else self.values[key[0]][key[1]]

    def write(self, key, value):
        if ARRAYS:
            self.values[key] = value
        else:
            self.values[key[0]][key[1]] = value

    def exit_initialization_mode(self):
        self.values["u_m"] = list(self.values["u_m0"])
        self.axes = [Axis(gains, torque) for gains, torque in zip(GAINS, self.values["u_m0"], strict=True)]

    def do_step(self, current_time, step_size):
        values = self.values
        errors = (q_m_ref - q_m for q_m_ref, q_m in zip(values["q_m_ref"], values["q_m"], strict=True))
        values["u_m"] = [axis.sample(e) for axis, e in zip(self.axes, errors, strict=True)]
        self.time = current_time + step_size
        return Fmi3StepResult()
