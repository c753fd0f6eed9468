"""The bits of published trajectories: short closed loops, and the hashes that every machine is to find for them.

A hash is the SHA-256 of a whole trajectory: its signals one after the other, as 64-bit numbers, little-endian, row by
row. ``published_bits.json`` holds those that are published.
"""

from __future__ import annotations

import hashlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..codec import from_json, to_json
from ..loop.scenario import Scenario
from ..loop.trajectory import Trajectory
from .case import Case
from .cases import case_named
from .protocol import load

PUBLISHED = Path(__file__).with_name("published_bits.json")
SIGNALS = ("q_m", "X", "measured", "command", "torque")
DURATION = Fraction(1)
"""Of a loop [s]; the disturbances begin earlier than in the protocol, so that they are within it."""


@dataclass(frozen=True)
class Pair:
    """A plant and a controller, names of FMUs of the benchmark."""

    plant: str
    controller: str
    compiler: bool
    """Whether a C compiler is needed to build them."""

    @property
    def name(self) -> str:
        """How the hashes' file calls it."""
        return f"{self.plant}+{self.controller}"


PAIRS = (
    Pair("FlexibleManipulator", "DiagonalPID", compiler=False),
    *(
        Pair("FlexibleManipulatorNative", controller, compiler=True)
        for controller in ("DiagonalPID_C", "DitheredLQG_C", "RobustLQG")
    ),
)

CASES = (
    "c00.compliant.noise",
    "c03.random_1.disturbance",
    "c07.slippery.gain_1",
    "c10.sticky.gain_2",
    "c12.compliant.delay_1",
    "c14.random_2.delay_2",
)
"""Each test of the protocol ``paper`` once, each of its systems."""


@dataclass(frozen=True)
class BitComparison:
    """What this machine found: its ``hashes`` beside those that are ``published``, by pair and case."""

    hashes: Mapping[str, str]
    published: Mapping[str, str]
    skipped: tuple[str, ...] = ()
    """Names of the pairs that were not simulated, as there is no C compiler."""

    @property
    def differing(self) -> tuple[str, ...]:
        """The trajectories whose hash is not the published one."""
        return tuple(name for name, value in self.hashes.items() if self.published.get(name) != value)

    @property
    def equal(self) -> bool:
        """Whether all that was simulated has the published bits."""
        return bool(self.hashes) and not self.differing


def short_case(id: str) -> Case:
    """A case of CASES with its disturbances within DURATION."""
    case = case_named(load("paper"), NOMINAL, 0, id)
    return replace(case, scenario=_short(case.scenario))


def _short(scenario: Scenario) -> Scenario:
    earlier = replace(scenario, duration=DURATION, stop_time=DURATION)
    if scenario.pulse.stop > 0.0:
        pulse = replace(scenario.pulse, start=0.1, stop=0.3)
        earlier = replace(earlier, pulse=pulse, chirp=replace(scenario.chirp, start=0.2, stop=0.9))
    return earlier


def hash_of(trajectory: Trajectory) -> str:
    """The SHA-256 of a trajectory, in hexadecimal."""
    digest = hashlib.sha256()
    for signal in SIGNALS:
        # Little-endian, so that machines of the other order find the same hash.
        digest.update(np.ascontiguousarray(getattr(trajectory, signal), dtype="<f8").tobytes())
    return digest.hexdigest()


def published() -> dict[str, str]:
    """The published hashes by pair and case."""
    return from_json(PUBLISHED.read_bytes(), dict[str, str])


def publish(hashes: Mapping[str, str]) -> None:
    """Write other hashes in their place."""
    PUBLISHED.write_text(to_json(dict(hashes)) + "\n", encoding="utf-8")
