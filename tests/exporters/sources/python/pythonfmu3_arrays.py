"""The two-axis PID as a pythonfmu3 slave whose variables are FMI 3.0 arrays of two.

The setters are its own: those of pythonfmu3 0.3.4 call ``np.reshape(newshape=...)``, which NumPy 2.4 dropped.
"""

from functools import partial

from pythonfmu3 import DefaultExperiment, Dimension, Float64, Fmi3Causality, Fmi3Slave, Fmi3StepResult, Fmi3Variability
from two_axis_pid_law import GAINS, T_S, Axis

CONNECTORS = (
    ("q_m_ref", Fmi3Causality.input, Fmi3Variability.continuous),
    ("q_m", Fmi3Causality.input, Fmi3Variability.continuous),
    ("u_m", Fmi3Causality.output, Fmi3Variability.discrete),
    ("u_m0", Fmi3Causality.parameter, Fmi3Variability.fixed),
)


class ArrayPID3(Fmi3Slave):
    """Each connector is an attribute, a list of two floats."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size=T_S)
        self.time = 0.0
        self.register_variable(
            Float64("time", causality=Fmi3Causality.independent, variability=Fmi3Variability.continuous)
        )
        for name, causality, variability in CONNECTORS:
            setattr(self, name, [0.0, 0.0])
            self.register_variable(
                Float64(
                    name,
                    causality=causality,
                    variability=variability,
                    dimensions=[Dimension(start="2")],
                    getter=partial(getattr, self, name),
                    setter=partial(setattr, self, name),
                )
            )

    def exit_initialization_mode(self):
        self.u_m = list(self.u_m0)
        self.axes = [Axis(gains, torque) for gains, torque in zip(GAINS, self.u_m0, strict=True)]

    def do_step(self, current_time, step_size):
        self.u_m = [
            axis.sample(reference - measured)
            for axis, reference, measured in zip(self.axes, self.q_m_ref, self.q_m, strict=True)
        ]
        self.time = current_time + step_size
        return Fmi3StepResult()
