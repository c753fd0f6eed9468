"""The motion under recorded torques, integrated anew.

Without its controller the arm falls, and an error of the start grows. So the time is cut into segments that begin at
the recorded angles. The speeds there are not recorded: they are those with which the first samples of the segment are
met best, and they have to agree with those that the segment before ends with. All segments are integrated side by side.

Beside DOP853 runs the method that the plant is documented to use, classical Runge-Kutta steps of fixed length: how far
the two are apart tells which differences are those of the method, as in a fast limit cycle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.integrate import DOP853

from .equations import Arm, rates

Array = np.ndarray

SEGMENT, FITTED = 400, 16
"""Samples of a segment, and those of its beginning that its speeds are fitted to."""

FITS = 6
"""Rounds of the fit, each linear in the speeds; the first begins with differences of the angles."""

NUDGE = np.array([1e-3, 1e-3, 1e-5, 1e-5])
"""Steps of the speeds dq_m, dq_a [rad/s] that sensitivities are taken with."""

TOLERANCE = 1e-9
"""Relative tolerance of the integrator; absolute on angles and speeds scaled by the ratio of the gears."""


@dataclass(frozen=True)
class Motion:
    """Angles at each sample, shape (N + 1, 2) [rad], and the jumps of the speeds dq_m and dq_a between segments, shape
    (segments, 2) [rad/s], the first one that from rest. ``method`` [rad] is how far fixed steps lead from that: the
    angles q_m, q_a, shape (N + 1, 4)."""

    q_m: Array
    q_a: Array
    jump_m: Array
    jump_a: Array
    method: Array


def integrated(arm: Arm, interval: float, q_m: Array, q_a: Array, u_m: Array, u_d: Array, force: Array) -> Motion:
    """The motion from the recorded angles ``q_m`` and ``q_a`` at the beginning of each segment.

    ``u_m``, ``u_d`` and ``force`` have shape (N, 2) and are held between two samples.
    """
    samples = len(u_m)
    begins = np.arange(0, samples, SEGMENT)
    length = min(SEGMENT, samples)
    inputs = np.stack([_cut(signal, begins, length) for signal in (u_m, u_d, force)])  # (3, 2, length, segments)
    recorded = np.concatenate([q_m, q_a], axis=1)
    start = recorded[begins].T
    following = [np.minimum(begins + number, samples) for number in (1, 2)]
    # A one-sided difference of second order, to begin the fit with.
    speeds = (-3.0 * start + 4.0 * recorded[following[0]].T - recorded[following[1]].T) / (2.0 * interval)
    fitted = min(FITTED, length)
    # Of the last segment there may be fewer samples; rows beyond the end repeat the last one and count nothing.
    rows = np.minimum(begins[None, :] + np.arange(1, fitted + 1)[:, None], samples)
    counted = begins[None, :] + np.arange(1, fitted + 1)[:, None] <= samples
    ratio = np.array([axis.n for axis in arm.axes])
    scale = np.concatenate([1.0 / ratio, [1.0, 1.0]])[None, :, None]
    for _ in range(FITS):
        nudged = np.concatenate([np.zeros((4, 1)), np.diag(NUDGE)], axis=1)  # (4, copies)
        speeds_now = speeds[:, :, None] + nudged[:, None, :]
        state = np.concatenate([np.broadcast_to(start[:, :, None], speeds_now.shape), speeds_now])
        path = _run(arm, interval, state, inputs[:, :, :fitted], ratio)[:, :4]  # (fitted, 4, segments, copies)
        error = (recorded[rows].transpose(0, 2, 1) - path[..., 0]) * scale * counted[:, None, :]
        slope = (path[..., 1:] - path[..., :1]) / NUDGE * scale[..., None] * counted[:, None, :, None]
        for segment in range(len(begins)):
            matrix = slope[:, :, segment].reshape(-1, 4)
            speeds[:, segment] += np.linalg.lstsq(matrix, error[:, :, segment].ravel(), rcond=None)[0]
    state = np.concatenate([start, speeds])
    path = _run(arm, interval, state, inputs, ratio)  # (length, 8, segments)
    # How far the plant's own method is from DOP853 tells which
    # differences are errors of a method, and not of an equation.
    apart = _run(arm, interval, state, inputs, ratio, substeps(arm, interval)) - path
    angles, method = recorded.copy(), np.zeros_like(recorded)
    ends = np.zeros((4, len(begins)))
    for place, begin in enumerate(begins):
        count = min(length, samples - begin)
        angles[begin + 1 : begin + 1 + count] = path[:count, :4, place]
        method[begin + 1 : begin + 1 + count] = apart[:count, :4, place]
        ends[:, place] = path[count - 1, 4:, place]
    before = np.concatenate([np.zeros((4, 1)), ends[:, :-1]], axis=1)
    jumps = (speeds - before).T
    return Motion(angles[:, :2], angles[:, 2:], jumps[:, :2], jumps[:, 2:], method)


def substeps(arm: Arm, interval: float) -> int:
    """Steps in a sample that docs/plant.md states, by the fastest rate of a motor: friction at rest and the gear's
    damping over its inertia. The link's share of the damping is left out, which is small."""
    fastest = max((a.f_d + a.alpha * a.f_c + a.d / a.n**2) / a.j_m for a in arm.axes)
    return 1 if interval * fastest <= 0.5 else max(2, int(np.ceil(interval * fastest / 1.7)))


def _cut(signal: Array, begins: Array, length: int) -> Array:
    """The signal of each segment, shape (2, length, segments); beyond the end its last value goes on."""
    rows = np.minimum(begins[None, :] + np.arange(length)[:, None], len(signal) - 1)
    pieces: Array = signal[rows].transpose(2, 0, 1)
    return pieces


def _run(arm: Arm, interval: float, state: Array, inputs: Array, ratio: Array, fixed: int = 0) -> Array:
    """States of shape ``state.shape`` after each sample; the inputs jump at samples, where the integrator begins anew.
    With so many ``fixed`` steps per sample by the classical method of fourth order, else by DOP853.

    The integrator sees angles and speeds of the motors divided by the ratio of the gears: its tolerance is one of link
    angles then.
    """
    shape, steps = state.shape, inputs.shape[2]
    scale = np.array([*ratio, 1.0, 1.0, *ratio, 1.0, 1.0]).reshape(8, *(1,) * (len(shape) - 1))
    more = (1,) * (len(shape) - 2)
    now, states = (state / scale).ravel(), np.empty((steps, *shape))
    step = None
    for k in range(steps):
        u_m, u_d, force = (signal[:, k].reshape(*signal[:, k].shape, *more) for signal in inputs)

        def slope(_t: float, y: Array, u_m: Array = u_m, u_d: Array = u_d, force: Array = force) -> Array:
            rate: Array = rates(arm, y.reshape(shape) * scale, u_m, u_d, force) / scale
            return rate.ravel()

        if fixed:
            now = _classical(slope, now, interval / fixed, fixed)
            states[k] = now.reshape(shape) * scale
            continue
        # A new integrator for each sample: the inputs jump there, and a step across a jump loses its order.
        solver = DOP853(slope, 0.0, now, interval, rtol=TOLERANCE, atol=TOLERANCE, first_step=step)
        while solver.status == "running":
            solver.step()
        if solver.status != "finished":
            raise FloatingPointError("the motion cannot be integrated")
        step = min(interval, float(solver.h_abs))
        now = solver.y
        states[k] = now.reshape(shape) * scale
    return states


def _classical(slope: Callable[[float, Array], Array], y: Array, h: float, steps: int) -> Array:
    for _ in range(steps):
        k_1 = slope(0.0, y)
        k_2 = slope(0.0, y + 0.5 * h * k_1)
        k_3 = slope(0.0, y + 0.5 * h * k_2)
        k_4 = slope(0.0, y + h * k_3)
        y = y + h / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
    return y
