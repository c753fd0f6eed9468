"""What a policy sees of the arm: the same eight numbers in training and in its FMU, in Python and in C."""

from collections.abc import Sequence

SIZE = 8
Z_P = 0.95
"""Pole of the derivative filter."""


class Observation:
    """(e, v, s, q_m_ref), for axis 1 and 2 each, from measured motor angles q_m and those to hold, q_m_ref [rad]::

        e = q_m_ref - q_m                          position error [rad]
        v = Z_P v + (1 - Z_P) (e - e of before)/h  its filtered derivative [rad/s]
        s = s + h e                                its integral [rad.s]

    All begin at 0. ``h`` [s] is the sample time.
    """

    def __init__(self) -> None:
        self.e, self.v, self.s = [0.0] * 2, [0.0] * 2, [0.0] * 2

    def sample(self, q_m_ref: Sequence[float], q_m: Sequence[float], h: float) -> list[float]:
        """The observation of the next sample."""
        for i in (0, 1):
            e = q_m_ref[i] - q_m[i]
            self.v[i] = Z_P * self.v[i] + (1.0 - Z_P) * (e - self.e[i]) / h
            self.s[i] = self.s[i] + h * e
            self.e[i] = e
        return [*self.e, *self.v, *self.s, *q_m_ref]
