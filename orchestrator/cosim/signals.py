"""The disturbances and imperfections of the loop, one small function each. Compiled, and callable from Python."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from .jit import compiled
from .scenario import Chirp, Noise, Pulse


class ChirpSignal(NamedTuple):
    """:class:`~orchestrator.cosim.scenario.Chirp` as a flat record for the compiled loop."""

    amplitude_1: float
    amplitude_2: float
    start: float
    stop: float
    f_start: float
    f_stop: float


class PulseSignal(NamedTuple):
    """:class:`~orchestrator.cosim.scenario.Pulse` as a flat record for the compiled loop."""

    x: float
    z: float
    start: float
    stop: float


def chirp_signal(chirp: Chirp) -> ChirpSignal:
    """The record of a chirp."""
    return ChirpSignal(*chirp.amplitude, chirp.start, chirp.stop, chirp.f_start, chirp.f_stop)


def pulse_signal(pulse: Pulse) -> PulseSignal:
    """The record of a pulse."""
    return PulseSignal(*pulse.force, pulse.start, pulse.stop)


@compiled
def chirp(signal, t):
    """Motor torque disturbance ``(u_d1, u_d2)`` [N.m] at time ``t`` [s]: A sin 2 pi (f_s tau + (f_e - f_s) tau^2 /
    (2 T)) with tau = t - start and T = stop - start, zero outside start <= t < stop."""
    if not signal.start <= t < signal.stop:
        return 0.0, 0.0
    tau = t - signal.start
    sweep = (signal.f_stop - signal.f_start) * tau * tau / (2.0 * (signal.stop - signal.start))
    wave = math.sin(2.0 * math.pi * (signal.f_start * tau + sweep))
    return signal.amplitude_1 * wave, signal.amplitude_2 * wave


@compiled
def pulse(signal, t):
    """Tool force ``(F_x, F_z)`` [N] at time ``t`` [s]: constant for start <= t < stop, zero outside."""
    if signal.start <= t < signal.stop:
        return signal.x, signal.z
    return 0.0, 0.0


@compiled
def saturate(value, limit):
    """``value`` held within +-``limit``."""
    return min(max(value, -limit), limit)


@compiled
def quantize(value, quantum):
    """``value`` rounded to the nearest multiple of ``quantum``; unchanged where the quantum is 0."""
    if quantum > 0.0:
        return np.rint(value / quantum) * quantum
    return value


@compiled
def amplify(value, centre, gain):
    """Loop gain about a working point, ``centre + gain (value - centre)``; at gain 1 exactly ``value``."""
    if gain == 1.0:
        return value
    return centre + gain * (value - centre)


def stable_stream(seed: tuple[int, ...]) -> np.random.RandomState:
    """Random numbers that a seed determines for good.

    NumPy guarantees the streams of its bit generators and of the frozen ``RandomState``, but not those of
    ``Generator``; a benchmark's noise has to outlive a library's next version.
    """
    return np.random.RandomState(np.random.PCG64(np.random.SeedSequence(seed)))


def noise(spec: Noise, samples: int) -> np.ndarray:
    """Measurement noise [rad] of shape (samples, 2)."""
    if spec.sigma == 0.0:
        return np.zeros((samples, 2))
    numbers = stable_stream(spec.seed).standard_normal((samples, 2))
    numbers *= spec.sigma  # in place: fresh memory costs more than the product
    return numbers
