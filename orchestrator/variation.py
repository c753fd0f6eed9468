"""Options that set or switch off single disturbances and imperfections of a scenario."""

from __future__ import annotations

import argparse
import math
from dataclasses import replace
from fractions import Fraction
from typing import Any

from . import commands
from .benchmark.protocol import Protocol
from .cosim.scenario import Chirp, Drive, Noise, Pulse, Scenario, Sensor
from .errors import InputError

NUMBER = commands.number()

LONGEST = 1000
"""Duration of a simulation [s] whose trajectory still fits into memory."""

MOST_BITS = 52
"""Of a quantizer: finer ones than floating-point numbers themselves make no sense."""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options; :func:`vary` applies them."""
    group = parser.add_argument_group(
        "disturbances and imperfections", "SI units; 0 switches off unless said otherwise"
    )

    def pair(name: str, text: str, kind: Any = NUMBER, metavar: tuple[str, str] = ("AXIS1", "AXIS2")) -> None:
        group.add_argument(name, nargs=2, type=kind, metavar=metavar, help=text)

    def number(name: str, text: str, kind: Any = NUMBER) -> None:
        group.add_argument(name, type=kind, metavar="VALUE", help=text)

    group.add_argument("--undisturbed", action="store_true", help="no chirp and no force but those given")
    group.add_argument("--ideal", action="store_true", help="no noise, quantization, saturation, delay but those given")
    number("--duration", f"length of the simulation [s], up to {LONGEST}", _duration)
    number("--noise-power", "P_n of the measurement noise", commands.number(0.0))
    number("--angle-bits", "steps of a motor revolution, as a power of two", _bits)
    number("--torque-bits", "steps of the torque range, as a power of two", _bits)
    pair("--torque-limit", "saturation [N.m] (inf: none)", commands.number(0.0, infinite=True))
    pair("--delay", "transport delay from controller to motor, T_d included [s]", commands.time)
    pair("--sensor-delay", "transport delay of the measurement [s]", commands.time)
    pair("--gain", "loop gain about the initial torque (1: none)")
    pair("--chirp-amplitude", "amplitude of the motor torque disturbance [N.m]")
    group.add_argument(
        "--chirp-frequencies", nargs=2, type=commands.number(0.0), metavar=("START", "END"), help="its frequencies [Hz]"
    )
    number("--t-3", "start of the chirp [s]")
    number("--t-4", "end of the chirp [s]")
    number("--force", "tool force [N]")
    number("--phi-F", "its direction [rad]")
    number("--t-1", "start of the force [s]")
    number("--t-2", "end of the force [s]")


def vary(scenario: Scenario, protocol: Protocol, options: argparse.Namespace) -> Scenario:
    """``scenario`` with the options that were given applied, the sweeping ones (undisturbed, ideal) first.

    Raises :class:`InputError` where a disturbance would end before it starts.
    """
    raw, fixed, loop = (protocol.raw[part] for part in ("disturbance", "fixed_disturbance", "loop"))

    def given(name: str, default: Any) -> Any:
        value = getattr(options, name)
        return default if value is None else tuple(value) if isinstance(value, list) else value

    sensor, drive, chirp, pulse = scenario.sensor, scenario.drive, scenario.chirp, scenario.pulse
    if options.undisturbed:
        chirp, pulse = replace(chirp, amplitude=(0.0, 0.0)), replace(pulse, force=(0.0, 0.0))
    if options.ideal:
        sensor, drive = Sensor(), Drive()

    if options.chirp_amplitude is not None and not chirp.stop:  # a test without a chirp gets the fixed one
        chirp = Chirp(start=fixed["t_3"], stop=raw["t_4"], f_start=fixed["f_start"], f_stop=fixed["f_stop"])
    direction = fixed["phi_F"]
    if pulse.stop:
        direction = math.atan2(scenario.pulse.force[1], scenario.pulse.force[0])
    elif options.force is not None:
        pulse = Pulse(start=raw["t_1"], stop=raw["t_2"])

    power = given("noise_power", None)
    sigma = sensor.noise.sigma if power is None else math.sqrt(power / scenario.longest_hold)
    angle_quantum, torque_quantum = sensor.quantum, drive.quantum
    if options.angle_bits is not None:
        angle_quantum = _quantum(math.radians(loop["angle_range_deg"]), options.angle_bits)
    if options.torque_bits is not None:
        first, second = (_quantum(2 * value, options.torque_bits) for value in loop["torque_limit"])
        torque_quantum = (first, second)
    F_x, F_z = pulse.force
    if options.force is not None or options.phi_F is not None:
        size = given("force", math.hypot(F_x, F_z))
        direction = given("phi_F", direction)
        F_x, F_z = size * math.cos(direction), size * math.sin(direction)
    f_start, f_stop = given("chirp_frequencies", (chirp.f_start, chirp.f_stop))
    varied = replace(
        scenario,
        duration=given("duration", scenario.duration),
        sensor=Sensor(
            noise=Noise(sigma, scenario.sensor.noise.seed),
            delay=given("sensor_delay", sensor.delay),
            quantum=angle_quantum,
        ),
        drive=Drive(
            gain=given("gain", drive.gain),
            limit=given("torque_limit", drive.limit),
            quantum=torque_quantum,
            delay=given("delay", drive.delay),
        ),
        chirp=Chirp(
            amplitude=given("chirp_amplitude", chirp.amplitude),
            start=given("t_3", chirp.start),
            stop=given("t_4", chirp.stop),
            f_start=f_start,
            f_stop=f_stop,
        ),
        pulse=Pulse((F_x, F_z), given("t_1", pulse.start), given("t_2", pulse.stop)),
    )
    for name, signal in (("force, --t-1 to --t-2", varied.pulse), ("chirp, --t-3 to --t-4", varied.chirp)):
        if signal.stop < signal.start:
            raise InputError(f"The {name}, would end at {signal.stop:g} s, before its start at {signal.start:g} s.")
    return varied


def _duration(text: str) -> Fraction:
    value = commands.time(text)
    if not 0 < value <= LONGEST:
        raise argparse.ArgumentTypeError(f"{text} s is no duration up to {LONGEST} s")
    return value


def _bits(text: str) -> int:
    if not text.isdecimal() or int(text) > MOST_BITS:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0 to {MOST_BITS}")
    return int(text)


def _quantum(span: float, bits: int) -> float:
    return span / 2**bits if bits > 0 else 0.0
