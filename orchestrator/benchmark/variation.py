"""Variations of a scenario: single disturbances and imperfections set or switched off."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from fractions import Fraction
from typing import TypeVar

from plant_fmu.flexible_manipulator.formulas import ANGLE_MAX, hypot

from ..entry import enter_fields
from ..errors import InputError
from ..loop.scenario import Chirp, Delays, Drive, Limits, Noise, Pair, Pulse, Scenario, Sensor, force, overlap
from .protocol import Protocol

T = TypeVar("T")

MAX_DURATION = 1000
"""Duration of a simulation [s] whose trajectory still fits into memory."""

NOT_NEGATIVE = (
    *("noise_power", "torque_limit", "delay", "sensor_delay", "jitter", "chirp_frequencies"),
    *("t_1", "t_2", "t_3", "t_4"),
)
"""What is a size or a time after the start; amplitudes, a force and a gain may have a sign."""

MAX_BITS = 52
"""Bits of a quantizer; finer ones than floating-point numbers themselves make no sense."""


@dataclass(frozen=True)
class Variation:
    """What is changed in a scenario, SI units; None leaves a value as it is.

    ``undisturbed`` removes chirp and force, and ``ideal`` noise, quantization, saturation and delay, except those that
    are given. ``angle_bits`` and ``torque_bits`` are the quantizers' steps as powers of two, 0 for none. The torque's
    steps are those of the range between the limits, also of a given ``torque_limit``; an infinite one is none, and has
    the protocol's steps. ``delay`` is that from controller to motor, T_d included. ``dropout`` is the probability that
    the torques of a sample are lost, ``jitter`` the largest time by which a measurement is taken too early.
    """

    undisturbed: bool = False
    ideal: bool = False
    duration: Fraction | None = None
    noise_power: float | None = None
    angle_bits: int | None = None
    torque_bits: int | None = None
    torque_limit: Limits | None = None
    delay: Delays | None = None
    sensor_delay: Delays | None = None
    dropout: float | None = None
    jitter: Fraction | None = None
    gain: Pair | None = None
    chirp_amplitude: Pair | None = None
    chirp_frequencies: Pair | None = None
    t_3: float | None = None
    t_4: float | None = None
    force: float | None = None
    phi_F: float | None = None
    t_1: float | None = None
    t_2: float | None = None

    def __post_init__(self) -> None:
        enter_fields(self)
        if self.duration is not None and not 0 < self.duration <= MAX_DURATION:
            message = f"The duration {float(self.duration):g} s is not between 0 and {MAX_DURATION} s."
            raise InputError(message, "bad-duration", "", float(self.duration))
        for bits in (self.angle_bits, self.torque_bits):
            if bits is not None and not 0 <= bits <= MAX_BITS:
                raise InputError(f"{bits} is not a number of bits from 0 to {MAX_BITS}.", "bad-bits", "", bits)
        if self.dropout is not None and not 0.0 <= self.dropout <= 1.0:
            message = f"The dropout {self.dropout:g} is not a probability from 0 to 1."
            raise InputError(message, "bad-dropout", "", self.dropout)
        # A negative delay was simulated as none, a negative limit turned the torque's sign; each without a word.
        for name in NOT_NEGATIVE:
            value = getattr(self, name)
            for number in value if isinstance(value, tuple) else (value,):
                if number is not None and number < 0:
                    message = f"{name} must not be negative, which {float(number):g} is."
                    raise InputError(message, "bad-number", name, float(number))

    def __repr__(self) -> str:
        changed = {
            field.name: getattr(self, field.name)
            for field in fields(self)
            if getattr(self, field.name) != field.default
        }
        return f"Variation({', '.join(f'{name}={value!r}' for name, value in changed.items())})"


def vary(scenario: Scenario, protocol: Protocol, variation: Variation) -> Scenario:
    """``scenario`` with the variation applied, the sweeping ones (undisturbed, ideal) first.

    Of disturbances that come again, the times are those of the first ones, and ``force`` and ``phi_F`` its force.

    Raises :class:`InputError` if a disturbance would end before it starts, would come again before it has ended, or has
    an angle without a sine.
    """
    rules, fixed, loop = protocol.disturbance, protocol.fixed_disturbance, protocol.loop
    sensor, drive, chirp, pulse = scenario.sensor, scenario.drive, scenario.chirp, scenario.pulse
    if variation.undisturbed:
        chirp, pulse = replace(chirp, amplitude=(0.0, 0.0)), replace(pulse, force=(0.0, 0.0))
    if variation.ideal:
        sensor, drive = Sensor(), Drive()
    if variation.chirp_amplitude is not None and not chirp.stop:  # a test without a chirp gets the fixed one
        chirp = Chirp(start=fixed.t_3, stop=rules.t_4, f_start=fixed.f_start, f_stop=fixed.f_stop)
    if variation.force is not None and not pulse.stop:
        pulse = Pulse(start=rules.t_1, stop=rules.t_2)

    sigma = sensor.noise.sigma
    if variation.noise_power is not None:
        # By the benchmark's sample time, whatever the controller's: the noise is the sensor's own.
        sigma = math.sqrt(variation.noise_power / scenario.longest_hold)
    angle_quantum, limit = sensor.quantum, _given(variation.torque_limit, drive.limit)
    if variation.angle_bits is not None:
        angle_quantum = _quantum(math.radians(loop.angle_range_deg), variation.angle_bits)
    f_start, f_stop = _given(variation.chirp_frequencies, (chirp.f_start, chirp.f_stop))
    varied = replace(
        scenario,
        duration=_given(variation.duration, scenario.duration),
        sensor=Sensor(
            noise=Noise(sigma, scenario.sensor.noise.seed),
            delay=_given(variation.sensor_delay, sensor.delay),
            quantum=angle_quantum,
            jitter=_given(variation.jitter, sensor.jitter),
        ),
        drive=Drive(
            gain=_given(variation.gain, drive.gain),
            limit=limit,
            quantum=_torque_quanta(drive, limit, loop.torque_limit, variation),
            delay=_given(variation.delay, drive.delay),
            dropout=_given(variation.dropout, drive.dropout),
        ),
        chirp=Chirp(
            amplitude=_given(variation.chirp_amplitude, chirp.amplitude),
            start=_given(variation.t_3, chirp.start),
            stop=_given(variation.t_4, chirp.stop),
            f_start=f_start,
            f_stop=f_stop,
        ),
        pulse=Pulse(
            _force(pulse.force, variation, scenario.pulse.force, fixed.phi_F),
            _given(variation.t_1, pulse.start),
            _given(variation.t_2, pulse.stop),
        ),
    )
    for name, signal in (("force", varied.pulse), ("chirp", varied.chirp)):
        if signal.stop < signal.start:
            message = f"The {name} would end at {signal.stop:g} s, before its start at {signal.start:g} s."
            raise InputError(message, "ends-before-start", name, signal.stop)
    if problem := overlap(varied):
        raise InputError(f"The disturbances come again, but {problem}.", "bad-repetition")
    turns = max(abs(varied.chirp.f_start), abs(varied.chirp.f_stop)) * (varied.chirp.stop - varied.chirp.start)
    for name, angle in (("direction of the force", variation.phi_F or 0.0), ("chirp", 2.0 * math.pi * turns)):
        # The benchmark's sine reduces its argument exactly up to there, with the same bits everywhere.
        if not abs(angle) <= ANGLE_MAX:
            message = f"The {name} comes to {angle:g} rad: its sine is computed up to {ANGLE_MAX:g} rad."
            raise InputError(message, "bad-number", name, angle)
    return varied


def _force(before: Pair, variation: Variation, planned: Pair, phi_F: float) -> Pair:
    """``before`` [N] with another size or direction; without a force, that of ``planned``, and else ``phi_F`` [rad]."""
    if variation.force is None and variation.phi_F is None:
        return before
    size, length = _given(variation.force, hypot(*before)), hypot(*planned)
    if variation.phi_F is None and length > 0.0:
        return size * (planned[0] / length), size * (planned[1] / length)
    return force(size, _given(variation.phi_F, phi_F))


def _torque_quanta(before: Drive, limit: Limits, planned: Limits, variation: Variation) -> Pair:
    """The torque's steps [N.m] with the ``limit`` in force: as many as ``before`` or as the variation has, over the
    range of the limit, and over that of the ``planned`` one if it is infinite. By the steps of a wider range, more than
    the limit would pass."""
    if variation.torque_bits is None and variation.torque_limit is None:
        return before.quantum
    spans, earlier = (_ranges(limits, planned) for limits in (limit, before.limit))
    if variation.torque_bits is not None:
        return _quantum(spans[0], variation.torque_bits), _quantum(spans[1], variation.torque_bits)
    # Numbers of steps are powers of two, so that these quotients are exact.
    first, second = (
        span / (was / quantum) if quantum > 0.0 else 0.0
        for span, was, quantum in zip(spans, earlier, before.quantum, strict=True)
    )
    return first, second


def _ranges(limits: Limits, planned: Limits) -> Pair:
    """From the lower to the upper limit of each torque [N.m]."""
    first, second = (
        2.0 * (limit if math.isfinite(limit) else other) for limit, other in zip(limits, planned, strict=True)
    )
    return first, second


def _given(value: T | None, default: T) -> T:
    return default if value is None else value


def _quantum(span: float, bits: int) -> float:
    return span / 2**bits if bits > 0 else 0.0
