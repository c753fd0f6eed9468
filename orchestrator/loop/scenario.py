"""The frozen description of one closed-loop simulation: what goes in, in SI units.

Every imperfection has a neutral value that switches it off: amplitude 0, sigma 0, quantum 0, limit infinite,
delay 0, gain 1, dropout 0, jitter 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from fractions import Fraction

Pair = tuple[float, float]
Limits = tuple[float, float]
Delays = tuple[Fraction, Fraction]

NO_DELAY: Delays = (Fraction(0), Fraction(0))


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

    @property
    def samples(self) -> int:
        """Number of controller samples; the last one begins before ``duration``."""
        return math.ceil(self.duration / self.sample_time)

    @property
    def announced(self) -> float:
        """The stop time [s] that FMUs are told."""
        return float(max(self.samples * self.sample_time, self.stop_time))
