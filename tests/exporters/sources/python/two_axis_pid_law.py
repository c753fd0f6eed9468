"""The PID of eq. (13) as a user would write it in a module of his own."""

GAINS = ((45.0, 30.0, 1.5, 0.95), (15.0, 10.0, 0.5, 0.95))
"""K_p [N.m/rad], K_i [N.m/(rad.s)], K_d [N.m.s/rad], z_p [1] of each axis."""

T_S = 0.25e-3
"""Sample time [s]."""


class Axis:
    """The controller of one axis."""

    def __init__(self, gains, torque):
        """Start from the torque [N.m] of the steady state."""
        self.gains = gains
        self.e, self.v, self.s = 0.0, 0.0, torque

    def sample(self, e):
        """Return the torque [N.m] for the position error ``e`` [rad]."""
        K_p, K_i, K_d, z_p = self.gains
        self.v = z_p * self.v + (1.0 - z_p) * (e - self.e) / T_S
        self.s = self.s + K_i * T_S * e
        self.e = e
        return K_p * e + K_d * self.v + self.s
