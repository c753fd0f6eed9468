"""The chirp on the motors and the force on the tool, as functions of time in plain Python.

:mod:`.signals` has them compiled; what only shows a simulation does without the compiler, which takes long to load.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from plant_fmu.flexible_manipulator.formulas import sin_cos

from .scenario import Chirp, Pair, Pulse


class ChirpSignal(NamedTuple):
    """:class:`~orchestrator.loop.scenario.Chirp` as a flat record for the compiled loop."""

    amplitude_1: float
    amplitude_2: float
    start: float
    stop: float
    f_start: float
    f_stop: float


class PulseSignal(NamedTuple):
    """:class:`~orchestrator.loop.scenario.Pulse` as a flat record for the compiled loop."""

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


def force(size: float, phi_F: float) -> Pair:
    """Tool force ``(F_x, F_z)`` [N] of ``size`` [N] in the direction ``phi_F`` [rad]."""
    sine, cosine = sin_cos(phi_F)
    return size * cosine, size * sine


def chirp(signal: ChirpSignal, t: float) -> tuple[float, float]:
    """Motor torque disturbance ``(u_d1, u_d2)`` [N.m] at time ``t`` [s]: A sin 2 pi (f_s tau + (f_e - f_s) tau^2 /
    (2 T)) with tau = t - start and T = stop - start, zero outside start <= t < stop."""
    if not signal.start <= t < signal.stop:
        return 0.0, 0.0
    # Phase of a linear sweep: 2 pi times the integral of f_start + (f_stop - f_start) tau / T.
    tau = t - signal.start
    sweep = (signal.f_stop - signal.f_start) * tau * tau / (2.0 * (signal.stop - signal.start))
    # The benchmark's own sine: those of C libraries differ in the last bit, and so would the trajectories.
    wave, _ = sin_cos(2.0 * math.pi * (signal.f_start * tau + sweep))
    return signal.amplitude_1 * wave, signal.amplitude_2 * wave


def pulse(signal: PulseSignal, t: float) -> tuple[float, float]:
    """Tool force ``(F_x, F_z)`` [N] at time ``t`` [s]: constant for start <= t < stop, zero outside."""
    if signal.start <= t < signal.stop:
        return signal.x, signal.z
    return 0.0, 0.0
