"""Options that set or switch off single disturbances and imperfections of a scenario."""

from __future__ import annotations

import argparse
import math
from dataclasses import fields
from typing import Any

from ..benchmark.variation import FINEST_BITS, MAX_DURATION, Variation
from .values import natural, number, time

NUMBER = number()


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options; :func:`variation` reads them. Each is a field of :class:`Variation`."""
    group = parser.add_argument_group(
        "disturbances and imperfections", "SI units; 0 switches off unless said otherwise"
    )

    def pair(name: str, text: str, kind: Any = NUMBER, metavar: tuple[str, str] = ("AXIS1", "AXIS2")) -> None:
        group.add_argument(name, nargs=2, type=kind, metavar=metavar, help=text)

    def single(name: str, text: str, kind: Any = NUMBER) -> None:
        group.add_argument(name, type=kind, metavar="VALUE", help=text)

    group.add_argument("--undisturbed", action="store_true", help="no chirp and no force but those given")
    group.add_argument("--ideal", action="store_true", help="no noise, quantization, saturation, delay but those given")
    single("--duration", f"length of the simulation [s], up to {MAX_DURATION}", time)
    single("--noise-power", "P_n of the measurement noise", number(0.0))
    single("--angle-bits", "steps of a motor revolution, as a power of two", natural(most=FINEST_BITS))
    single("--torque-bits", "steps of the torque range, as a power of two", natural(most=FINEST_BITS))
    pair("--torque-limit", "saturation [N.m] (inf: none)", number(0.0, infinite=True))
    pair("--delay", "transport delay from controller to motor, T_d included [s]", time)
    pair("--sensor-delay", "transport delay of the measurement [s]", time)
    single("--dropout", "probability that the torques of a sample are lost and the former held", number(0.0, most=1.0))
    single("--jitter", "largest random time by which angles are measured before their sample [s]", time)
    pair("--gain", "loop gain about the initial torque (1: none)")
    pair("--chirp-amplitude", "amplitude of the motor torque disturbance [N.m]")
    pair("--chirp-frequencies", "its frequencies [Hz]", number(0.0), ("START", "END"))
    single("--t-3", "start of the chirp [s]")
    single("--t-4", "end of the chirp [s]")
    single("--force", "tool force [N]")
    direction = group.add_mutually_exclusive_group()
    direction.add_argument("--phi-F", type=NUMBER, metavar="RADIANS", help="its direction [rad]")
    direction.add_argument(
        "--force-direction",
        dest="phi_F",
        type=lambda word: math.radians(NUMBER(word)),
        metavar="DEGREES",
        help="the same in degrees",
    )
    single("--t-1", "start of the force [s]")
    single("--t-2", "end of the force [s]")


def variation(given: argparse.Namespace) -> Variation:
    """The variation that the options describe."""
    values: dict[str, Any] = {field.name: getattr(given, field.name) for field in fields(Variation)}
    values = {name: tuple(value) if isinstance(value, list) else value for name, value in values.items()}
    return Variation(**values)
