"""The frozen description of one closed-loop simulation: what goes in, in SI units; and what the loop makes of it, in
plain Python, as the compiler takes long to load.

Every imperfection has a neutral value that switches it off: amplitude 0, sigma 0, quantum 0, limit infinite,
delay 0, gain 1, dropout 0, jitter 0.

Transport delays become a plan for every sample interval: where the plant's step is split, which torque acts in each
part, where a delayed measurement is taken. Times are exact fractions, so that a delay of 0.3 samples splits a step at
0.3 and a delay of a whole sample does not split it at all. The plan is the same for every sample interval, unless the
measurement has jitter; the loop applies it by the sample's index.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from plant_fmu.flexible_manipulator.formulas import sin_cos

from ..errors import InputError

Pair = tuple[float, float]
Limits = tuple[float, float]
Delays = tuple[Fraction, Fraction]

NO_DELAY: Delays = (Fraction(0), Fraction(0))

NANOSECONDS = 1e9
"""Per second."""


@dataclass(frozen=True)
class Noise:
    """White measurement noise: ``sigma`` [rad] per sample, and the seed words that determine every sample. Dropout and
    jitter have streams of their own, with other words behind these."""

    sigma: float = 0.0
    seed: tuple[int, ...] = (0,)


@dataclass(frozen=True)
class Sensor:
    """Measurement of the motor angles: noise, then transport delay [s] per axis, then rounding to ``quantum`` [rad].
    Sample by sample both angles are taken earlier by a random time up to ``jitter`` [s]."""

    noise: Noise = Noise()
    delay: Delays = NO_DELAY
    quantum: float = 0.0
    jitter: Fraction = Fraction(0)


@dataclass(frozen=True)
class Drive:
    """The way of a torque command: ``gain`` about the initial torque, saturation at ``limit`` [N.m], rounding to
    ``quantum`` [N.m], transport delay [s]; each per axis. The commands of a sample are lost with the probability
    ``dropout``, those of both axes together."""

    gain: Pair = (1.0, 1.0)
    limit: Limits = (math.inf, math.inf)
    quantum: Pair = (0.0, 0.0)
    delay: Delays = NO_DELAY
    dropout: float = 0.0


@dataclass(frozen=True)
class Chirp:
    """Motor torque disturbance u_d: per-axis ``amplitude`` [N.m], from ``start`` until ``stop`` [s], its frequency
    linear in time from ``f_start`` to ``f_stop`` [Hz], both axes in phase."""

    amplitude: Pair = (0.0, 0.0)
    start: float = 0.0
    stop: float = 0.0
    f_start: float = 0.0
    f_stop: float = 0.0


@dataclass(frozen=True)
class Pulse:
    """Tool force ``force`` [N] in x and z, from ``start`` until ``stop`` [s]."""

    force: Pair = (0.0, 0.0)
    start: float = 0.0
    stop: float = 0.0


@dataclass(frozen=True)
class Recurrence:
    """Chirp and pulse come ``number`` times, every ``period`` [s]; each force is turned by ``turn`` [rad] from the one
    before. The neutral value is once."""

    period: float = 0.0
    number: int = 1
    turn: float = 0.0


class Repetition(NamedTuple):
    """One coming of the disturbances, times in seconds. What happens from ``begin`` on belongs to it, until the next
    one: its chirp starts at ``chirp``, its force at ``force``, which ends at ``release``."""

    begin: float
    chirp: float
    force: float
    release: float


@dataclass(frozen=True)
class Scenario:
    """One simulation, completely: with the bytes of the two FMUs it determines every number that comes out.

    ``parameters`` are start values of the plant by FMI name, ``duration`` [s] and ``sample_time`` [s] exact.
    The simulation is abandoned when the TCP is more than ``abort_distance`` [m] from where it began. The disturbances
    are held no longer than ``longest_hold`` [s], however slowly the controller samples. FMUs are told of the later end
    of this one and ``stop_time`` [s], so that equal ones do not tell which simulation it is.
    """

    parameters: tuple[tuple[str, float], ...]
    duration: Fraction
    sample_time: Fraction
    sensor: Sensor = field(default_factory=Sensor)
    drive: Drive = field(default_factory=Drive)
    chirp: Chirp = field(default_factory=Chirp)
    pulse: Pulse = field(default_factory=Pulse)
    abort_distance: float = math.inf
    longest_hold: Fraction = Fraction(1, 4000)
    stop_time: Fraction = Fraction(0)
    again: Recurrence = field(default_factory=Recurrence)

    @property
    def samples(self) -> int:
        """Number of controller samples; the last one begins before ``duration``."""
        return math.ceil(self.duration / self.sample_time)

    @property
    def announced(self) -> float:
        """The stop time [s] that FMUs are told."""
        return float(max(self.samples * self.sample_time, self.stop_time))

    @property
    def repetitions(self) -> tuple[Repetition, ...]:
        """All comings of the disturbances. The first one begins with the simulation, each other one with its chirp or
        its force, whichever is earlier."""
        chirp, pulse, again = self.chirp, self.pulse, self.again
        first = Repetition(0.0, chirp.start, pulse.start, pulse.stop)
        times = (min(chirp.start, pulse.start), *first[1:])
        others = (Repetition(*(later(t, n, again.period) for t in times)) for n in range(1, again.number))
        return first, *others

    @property
    def disturbed_until(self) -> float:
        """When the last disturbance has ended [s]."""
        return later(max(self.chirp.stop, self.pulse.stop), self.again.number - 1, self.again.period)


class ChirpSignal(NamedTuple):
    """:class:`Chirp` as a flat record for the compiled loop."""

    amplitude_1: float
    amplitude_2: float
    start: float
    stop: float
    f_start: float
    f_stop: float
    period: float = 0.0
    number: int = 1


class PulseSignal(NamedTuple):
    """:class:`Pulse` as a flat record for the compiled loop."""

    x: float
    z: float
    start: float
    stop: float
    period: float = 0.0
    number: int = 1
    turn: float = 0.0


def chirp_signal(chirp: Chirp, again: Recurrence) -> ChirpSignal:
    """The record of a chirp that comes ``again``."""
    times = chirp.start, chirp.stop, chirp.f_start, chirp.f_stop
    return ChirpSignal(*chirp.amplitude, *times, again.period, again.number)


def pulse_signal(pulse: Pulse, again: Recurrence) -> PulseSignal:
    """The record of a pulse that comes ``again``."""
    return PulseSignal(*pulse.force, pulse.start, pulse.stop, again.period, again.number, again.turn)


def overlap(scenario: Scenario) -> str:
    """What is wrong with the times of disturbances that come again, as a clause; empty if nothing is.

    A figure of a force is measured until the next disturbance begins: so a chirp must not begin during or after the
    force of its own repetition, nor a repetition before the one before it has ended.
    """
    chirp, pulse, again = scenario.chirp, scenario.pulse, scenario.again
    if again.number == 1:
        return ""
    if not chirp.start <= chirp.stop <= pulse.start:
        return f"the chirp ends at {chirp.stop:g} s, after the force begins at {pulse.start:g} s"
    if not pulse.stop - chirp.start <= again.period:
        return f"chirp and force take {pulse.stop - chirp.start:g} s, longer than the period of {again.period:g} s"
    return ""


def force(size: float, phi_F: float) -> Pair:
    """Tool force ``(F_x, F_z)`` [N] of ``size`` [N] in the direction ``phi_F`` [rad]."""
    sine, cosine = sin_cos(phi_F)
    return size * cosine, size * sine


def later(time: float, n: int, period: float) -> float:
    """``time`` [s] ``n`` periods later, rounded to a nanosecond; ``time`` itself for n = 0."""
    if n == 0:
        return time
    # The sum of two floats may be a last place beside the time of a sample that is
    # meant, 0.05 + 3 * 0.1 > 0.35: the disturbance would begin a sample late.
    return math.floor((time + n * period) * NANOSECONDS + 0.5) / NANOSECONDS


def latest(start: float, period: float, number: int, t: float) -> int:
    """Which of ``number`` repetitions, the first of which begins at ``start``, is the last that has begun at ``t``: 0
    for the first; -1 if none has. Times in seconds."""
    if t < start:
        return -1
    if number == 1:
        return 0
    n = min(int((t - start) / period), number - 1)
    # The quotient is rounded, so near a beginning it may be one off to either side.
    if n + 1 < number and later(start, n + 1, period) <= t:
        return n + 1
    return n - 1 if later(start, n, period) > t else n


def chirp(signal: ChirpSignal, t: float) -> tuple[float, float]:
    """Motor torque disturbance ``(u_d1, u_d2)`` [N.m] at time ``t`` [s]: A sin 2 pi (f_s tau + (f_e - f_s) tau^2 /
    (2 T)) with tau = t - start and T = stop - start, zero outside start <= t < stop; the same in each repetition."""
    n = latest(signal.start, signal.period, signal.number, t)
    if n < 0 or not t < later(signal.stop, n, signal.period):
        return 0.0, 0.0
    # Phase of a linear sweep: 2 pi times the integral of f_start + (f_stop - f_start) tau / T.
    tau = t - later(signal.start, n, signal.period)
    sweep = (signal.f_stop - signal.f_start) * tau * tau / (2.0 * (signal.stop - signal.start))
    # The benchmark's own sine: those of C libraries differ in the last bit, and so would the trajectories.
    wave, _ = sin_cos(2.0 * math.pi * (signal.f_start * tau + sweep))
    return signal.amplitude_1 * wave, signal.amplitude_2 * wave


def pulse(signal: PulseSignal, t: float) -> tuple[float, float]:
    """Tool force ``(F_x, F_z)`` [N] at time ``t`` [s]: constant for start <= t < stop, zero outside; in
    repetition n turned by n times the turn."""
    n = latest(signal.start, signal.period, signal.number, t)
    if n < 0 or not t < later(signal.stop, n, signal.period):
        return 0.0, 0.0
    if n == 0:
        return signal.x, signal.z
    return turned(signal.x, signal.z, n * signal.turn)


def turned(x: float, z: float, angle: float) -> tuple[float, float]:
    """The vector ``(x, z)``, turned by ``angle`` [rad] from x to z."""
    sine, cosine = sin_cos(angle)
    return x * cosine - z * sine, x * sine + z * cosine


MAX_TICKS_PER_SECOND = 10**14
"""Largest number of ticks per second: 64-bit integers then count to 92,000 s."""

CELLS = 2**16
"""Of the jitter: so many times are equally likely."""


class Plan(NamedTuple):
    """The parts of the sample intervals, for the compiled loop. Interval k has row r = k modulo the number of rows:
    one row serves all intervals, or each has its own.

    The time of part p in interval k is ``(k * interval + offset[r, p]) / denominator`` seconds: integers, never
    accumulated. In part p axis i is driven by the command of sample ``k - drive_lag[r, p, i]``. Axis i is measured at
    the end of part ``sample_part[r, i]``, and the controller at sample k is given the value taken for sample
    ``k - sensor_lag[i]``.
    """

    interval: int
    denominator: int
    offset: np.ndarray
    """int64, shape (rows, parts)."""
    step: np.ndarray
    """Length of each part [s], shape (rows, parts)."""
    drive_lag: np.ndarray
    """int64, shape (rows, parts, 2)."""
    sample_part: np.ndarray
    """int64, shape (rows, 2)."""
    sensor_lag: np.ndarray
    """int64, shape (2,)."""


def make_plan(
    sample_time: Fraction,
    drive: Delays,
    sensor: Delays,
    longest: Fraction | None = None,
    jitter: Fraction = Fraction(0),
    cells: np.ndarray | None = None,
) -> Plan:
    """The plan for a sample time and the transport delays per axis, all exact and in seconds.

    No part is longer than ``longest``; by default there is no such limit.

    A command of sample k reaches the motor at t_k + delay; a measurement for sample k is taken at t_k minus the
    fractional part of the sensor's delay and given to the controller so many whole samples later. With ``jitter`` the
    measurement for sample k is taken earlier than that by ``cells[k]`` of the :data:`CELLS` cells of this time, and
    one tick, so that it never falls on the beginning of a part; ``cells`` has shape (intervals + 1,).

    Raises :class:`InputError` if the times have no common grid that integers can count, or the measurement for a sample
    could be taken before the interval that ends at it.
    """
    # Fractions: in floats, divmod(0.00225, 0.00025) is (8, 0.00025), a whole sample more.
    whole_drive, arrival = zip(*(divmod(delay, sample_time) for delay in drive), strict=True)
    whole_sensor, early = zip(*(divmod(delay, sample_time) for delay in sensor), strict=True)
    if not 0 <= jitter <= sample_time - max(early):
        message = f"The jitter of {float(jitter):g} s is not from 0 to the sample time of {float(sample_time):g} s, "
        raise InputError(f"{message}less the part of a sample by which the measurement is delayed.", "bad-jitter")
    takes = [sample_time - part for part in early]
    # The plant's substeps are of the benchmark's step: a slow controller must not coarsen the integration.
    holds = math.ceil(sample_time / longest) if longest else 1
    regular = [number * sample_time / holds for number in range(holds)]
    fixed = sorted({*regular, *arrival, *(take for take in takes if take < sample_time and not jitter)})
    times = (sample_time, *fixed, *takes, jitter / CELLS)
    # Twice as fine with jitter: fixed times are at even ticks then, and a
    # measurement at an odd one, so the two never fall together.
    denominator = math.lcm(*(time.denominator for time in times)) * (2 if jitter else 1)
    # int64 in the compiled loop wraps around without an error.
    if denominator > MAX_TICKS_PER_SECOND:
        message = f"Sample time and delays have no common grid of {1 / MAX_TICKS_PER_SECOND:g} s or coarser."
        raise InputError(f"{message} Give them with fewer digits.", "bad-time")

    def ticks(time: Fraction) -> int:
        return int(time * denominator)

    # What is fixed is at even ticks then, and a measurement at an odd one.
    shift = np.zeros(1, dtype=np.int64) if cells is None else cells[1:] * ticks(jitter / CELLS) + 1
    moved = sorted(set(takes)) if jitter else []
    begins = [*(np.full(len(shift), ticks(time)) for time in fixed), *(ticks(take) - shift for take in moved)]
    offset = np.sort(np.column_stack(begins).astype(np.int64))
    ends = np.column_stack([offset[:, 1:], np.full(len(shift), ticks(sample_time))])
    taken = np.column_stack([ticks(take) - shift for take in takes])
    # In the parts before the arrival the command of the sample before still acts.
    late = offset[:, :, None] < np.array([ticks(time) for time in arrival])
    return Plan(
        interval=ticks(sample_time),
        denominator=denominator,
        offset=np.ascontiguousarray(offset),
        step=np.ascontiguousarray((ends - offset) / denominator),
        drive_lag=np.ascontiguousarray(late + np.array([int(whole) for whole in whole_drive], dtype=np.int64)),
        sample_part=np.argmax(ends[:, :, None] == taken[:, None, :], axis=1).astype(np.int64),
        sensor_lag=np.array([int(whole) for whole in whole_sensor], dtype=np.int64),
    )
