"""What acts on the arm and what the controller is given, computed from the numbers of a scenario."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

Array = np.ndarray


@dataclass(frozen=True)
class RecordedScenario:
    """The numbers of a simulation in SI units; pairs are per axis, lags are whole samples."""

    sample_time: float
    sigma: float
    sensor_lag: tuple[int, int]
    angle_quantum: float
    gain: tuple[float, float]
    limit: tuple[float, float]
    torque_quantum: tuple[float, float]
    drive_lag: tuple[int, int]
    chirp_amplitude: tuple[float, float]
    chirp_times: tuple[float, float]
    chirp_frequencies: tuple[float, float]
    force: tuple[float, float]
    force_times: tuple[float, float]
    period: float = 0.0
    number: int = 1
    turn: float = 0.0
    """Both disturbances come so many times, every ``period`` [s], and the force is turned by so much [rad] each
    time."""

    def repeated(self, time: float) -> Array:
        """``time`` [s] in each repetition. All but the first are whole nanoseconds: a sum of floats may be a last place
        beside the time of a sample."""
        times = np.round(time + self.period * np.arange(self.number), 9)
        times[0] = time
        return times


def rounded(values: Array, quantum: float) -> Array:
    """To the nearest multiple of ``quantum``; as they are if that is 0."""
    multiples: Array = np.rint(values / quantum) * quantum if quantum else values
    return multiples


def tied(values: Array, quantum: float, within: float = 1e-6) -> Array:
    """Where a value lies so near to the middle between two multiples, in shares of ``quantum``, that the last bit
    decides."""
    if not quantum:
        return np.zeros(values.shape, dtype=bool)
    share = values / quantum
    near_middle: Array = np.abs(np.abs(share - np.floor(share)) - 0.5) < within
    return near_middle


def delayed(values: Array, lags: tuple[int, int], before: Array) -> Array:
    """Columns of shape (N, 2), each so many samples later; before its first value stands that of ``before``."""
    late = np.empty_like(values)
    for i, lag in enumerate(lags):
        late[:lag, i] = before[i]
        late[lag:, i] = values[: len(values) - lag, i]
    return late


def limited(command: Array, u_m0: Array, scenario: RecordedScenario) -> Array:
    """The torques of a controller after loop gain and limits, before they are rounded, shape (N, 2) [N.m]."""
    gain = np.array(scenario.gain)
    asked = np.where(gain == 1.0, command, u_m0 + gain * (command - u_m0))
    return np.clip(asked, -np.array(scenario.limit), scenario.limit)


def chirp(scenario: RecordedScenario, samples: int) -> Array:
    """Motor torque disturbance at each sample, shape (samples, 2) [N.m]: its frequency grows linearly in time."""
    t = np.arange(samples) * scenario.sample_time
    (begin, end), (low, high) = scenario.chirp_times, scenario.chirp_frequencies
    if end <= begin:
        return np.zeros((samples, 2))
    wave = np.zeros(samples)
    for start, stop in zip(scenario.repeated(begin), scenario.repeated(end), strict=True):
        on = (start <= t) & (t < stop)
        since = t[on] - start
        wave[on] = np.sin(2.0 * np.pi * (low * since + 0.5 * (high - low) / (end - begin) * since**2))
    torques: Array = wave[:, None] * np.array(scenario.chirp_amplitude)
    return torques


def force(scenario: RecordedScenario, samples: int) -> Array:
    """Tool force at each sample, shape (samples, 2) [N]."""
    t = np.arange(samples) * scenario.sample_time
    forces, (x, z) = np.zeros((samples, 2)), scenario.force
    begins, ends = map(scenario.repeated, scenario.force_times)
    for n, (begin, end) in enumerate(zip(begins, ends, strict=True)):
        cosine, sine = np.cos(n * scenario.turn), np.sin(n * scenario.turn)
        forces[(begin <= t) & (t < end)] = x * cosine - z * sine, x * sine + z * cosine
    return forces
