"""A controller in Python: a PID for each axis. Replace the class Axis by your own."""

from pythonfmu import DefaultExperiment, Fmi2Causality, Fmi2Slave, Fmi2Variability, Real

T_S = 0.25e-3  # sample time [s]


class Axis:
    """The controller of one axis, which starts from the torque [N.m] of the steady state."""

    def __init__(self, K_p, K_i, K_d, torque):
        self.K_p, self.K_i, self.K_d = K_p, K_i, K_d
        self.e, self.v, self.s = 0.0, 0.0, torque

    def sample(self, e):
        """Return the torque [N.m] for the position error ``e`` [rad]; called once every T_S."""
        z_p = 0.95  # pole of the derivative filter
        self.v = z_p * self.v + (1.0 - z_p) * (e - self.e) / T_S
        self.s = self.s + self.K_i * T_S * e
        self.e = e
        return self.K_p * e + self.K_d * self.v + self.s


class MyController(Fmi2Slave):
    """What the benchmark connects: q_m_ref, q_m [rad] and u_m, u_m0 [N.m], each for axis 1 and 2."""

    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.default_experiment = DefaultExperiment(step_size=T_S)
        self.q_m_ref_1 = self.q_m_ref_2 = 0.0
        self.q_m_1 = self.q_m_2 = 0.0
        self.u_m_1 = self.u_m_2 = 0.0
        self.u_m0_1 = self.u_m0_2 = 0.0
        for axis in ("1", "2"):
            self.register_variable(Real("q_m_ref_" + axis, causality=Fmi2Causality.input))
            self.register_variable(Real("q_m_" + axis, causality=Fmi2Causality.input))
            self.register_variable(Real("u_m_" + axis, causality=Fmi2Causality.output))
            self.register_variable(
                Real("u_m0_" + axis, causality=Fmi2Causality.parameter, variability=Fmi2Variability.fixed)
            )

    def exit_initialization_mode(self):
        """Start from the steady state; parameters have their values by now, in __init__ they have not."""
        self.axis_1 = Axis(45.0, 30.0, 1.5, self.u_m0_1)
        self.axis_2 = Axis(15.0, 10.0, 0.5, self.u_m0_2)
        self.u_m_1, self.u_m_2 = self.u_m0_1, self.u_m0_2

    def do_step(self, current_time, step_size):
        """Sample the inputs once."""
        self.u_m_1 = self.axis_1.sample(self.q_m_ref_1 - self.q_m_1)
        self.u_m_2 = self.axis_2.sample(self.q_m_ref_2 - self.q_m_2)
        return True
