"""The closed loop of the benchmark in one compiled function, for tuning: manipulator, imperfections, controller.

What orchestrator/loop/closed_loop.py does with two FMUs in 4 us per sample takes 1 us here, from the plant's own
compiled equations. The order of events within a sample is that of docs/timing.md.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numba
import numpy as np

from controller_fmu.friction import flexible_manipulator_dither
from controller_fmu.friction.flexible_manipulator_dither import Dither
from orchestrator.loop.signals import ChirpSignal, PulseSignal, chirp, pulse, quantize, saturate
from plant_fmu.flexible_manipulator.integrator import STATE, along, derivative, unpack
from plant_fmu.flexible_manipulator.kinematics import tcp

NO_DITHER = Dither(0.0, 0.0, 1.0, 0.0, 1.0, 0.0)
"""Constants of a dither that is none."""

dither = numba.njit(nogil=True)(flexible_manipulator_dither.dither)


class Law(NamedTuple):
    """A controller: (z+, u+, tool error) = matrix (z, u, e), and the dither that is added to u+.

    ``matrix`` has shape (n + 4, n + 4) for n states z; u is the torque about u_m0 [N.m], e = q_m - q_m_ref [rad].
    All begins at zero.
    """

    matrix: np.ndarray
    dither: Dither = NO_DITHER


class Course(NamedTuple):
    """One simulation, everything but the controller; arrays of shape (2,) hold one value per axis."""

    memory: np.ndarray
    """The plant at rest, see plant_fmu/flexible_manipulator/integrator.py."""
    samples: int
    gain: np.ndarray
    lag: np.ndarray
    """Delay of the torques [samples], int64."""
    limit: np.ndarray
    torque_quantum: np.ndarray
    angle_quantum: float
    noise: np.ndarray
    """Measurement noise [rad], shape (samples + 1, 2)."""
    chirp: ChirpSignal
    pulse: PulseSignal


# No fast-math: the bits of a result, and with them the path of a search, would depend on the optimiser's choices.
@numba.njit(nogil=True, error_model="numpy")
def simulate(
    course: Course, law: Law, T_s: float, substeps: int, abort_distance: float, X: np.ndarray, torque: np.ndarray
) -> int:
    """Fill ``X`` (samples + 1, 2) with TCP positions [m] and ``torque`` (samples, 2) [N.m].

    Returns the number of samples reached; fewer than asked for if the TCP moved further than ``abort_distance`` [m].
    """
    memory = course.memory[STATE:]
    arm, joint_1, joint_2 = unpack(memory[9:])
    x = (memory[0], memory[1], memory[2], memory[3], memory[4], memory[5], memory[6], memory[7])
    q_m_ref = (x[2], x[3])
    u_m0 = (course.memory[0], course.memory[1])
    h = T_s / substeps
    size = law.matrix.shape[0]
    now, after = np.zeros(size), np.zeros(size)
    level = 0.0
    X[0, 0], X[0, 1] = tcp(arm, x[0], x[1])
    for k in range(course.samples):
        for i in range(2):
            now[size - 2 + i] = quantize(x[2 + i] + course.noise[k, i], course.angle_quantum) - q_m_ref[i]
        for row in range(size):
            total = 0.0
            for column in range(size):
                total += law.matrix[row, column] * now[column]
            after[row] = total
        if law.dither.amplitude_1 > 0.0:
            level, shake_1, shake_2 = dither(law.dither, level, math.hypot(after[size - 2], after[size - 1]), k)
            after[size - 4] = saturate(u_m0[0] + after[size - 4] + shake_1, course.limit[0]) - u_m0[0]
            after[size - 3] = saturate(u_m0[1] + after[size - 3] + shake_2, course.limit[1]) - u_m0[1]
        for i in range(2):
            asked = saturate(u_m0[i] + course.gain[i] * after[size - 4 + i], course.limit[i])
            torque[k, i] = quantize(asked, course.torque_quantum[i])
        now, after = after, now

        u_1 = torque[k - course.lag[0], 0] if k >= course.lag[0] else u_m0[0]
        u_2 = torque[k - course.lag[1], 1] if k >= course.lag[1] else u_m0[1]
        u_d1, u_d2 = chirp(course.chirp, k * T_s)
        F_x, F_z = pulse(course.pulse, k * T_s)
        tau_1, tau_2 = joint_1.gamma * u_1 + u_d1, joint_2.gamma * u_2 + u_d2
        for _ in range(substeps):
            k_1 = derivative(arm, joint_1, joint_2, x, tau_1, tau_2, F_x, F_z)
            k_2 = derivative(arm, joint_1, joint_2, along(x, 0.5 * h, k_1), tau_1, tau_2, F_x, F_z)
            k_3 = derivative(arm, joint_1, joint_2, along(x, 0.5 * h, k_2), tau_1, tau_2, F_x, F_z)
            k_4 = derivative(arm, joint_1, joint_2, along(x, h, k_3), tau_1, tau_2, F_x, F_z)
            x = along(x, h / 6.0, along(along(along(k_1, 2.0, k_2), 2.0, k_3), 1.0, k_4))
        X[k + 1, 0], X[k + 1, 1] = tcp(arm, x[0], x[1])
        if not math.hypot(X[k + 1, 0] - X[0, 0], X[k + 1, 1] - X[0, 1]) <= abort_distance:
            return k + 1
    return course.samples
