"""The two-axis PID with component-model, whose vectors are NumPy arrays and whose starts carry the units."""

from component_model.model import Model
from two_axis_pid_law import GAINS, T_S, Axis


class ComponentModelPID(Model):
    """Vectors become scalars that count from zero: ``q_m[0]`` and ``q_m[1]``."""

    def __init__(self, name="ComponentModelPID", **kwargs):
        super().__init__(name, "Diagonal PID with derivative filter", default_experiment={"stepSize": T_S}, **kwargs)
        for connector, causality, variability, unit in (
            ("q_m_ref", "input", "continuous", "rad"),
            ("q_m", "input", "continuous", "rad"),
            ("u_m", "output", "discrete", "N*m"),
            ("u_m0", "parameter", "fixed", "N*m"),
        ):
            start = (f"0.0 {unit}", f"0.0 {unit}")
            self.add_variable(connector, causality=causality, variability=variability, start=start)

    def exit_initialization_mode(self):
        super().exit_initialization_mode()
        self.u_m[:] = self.u_m0
        self.axes = [Axis(gains, float(torque)) for gains, torque in zip(GAINS, self.u_m0, strict=True)]

    def do_step(self, current_time, step_size):
        super().do_step(current_time, step_size)
        for i, axis in enumerate(self.axes):
            self.u_m[i] = axis.sample(float(self.q_m_ref[i]) - float(self.q_m[i]))
        return True
