"""A protocol is a file: which configurations, systems and tests make an evaluation. Here it becomes cases."""

from __future__ import annotations

import math
import re
import sys
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib import resources
from itertools import product
from typing import Any

import numpy as np

from ..cosim.scenario import Chirp, Drive, Noise, Pulse, Scenario, Sensor, seconds
from ..cosim.signals import stable_stream
from ..errors import InputError
from .case import Case, Configuration, Disturbance, System, Test

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FILES = resources.files(__package__) / "protocols"

DRAWS, NOISE = 0, 1
"""Last seed word of the two random streams of a configuration and system."""


@dataclass(frozen=True)
class Criterion:
    """A target of Section 6: B_i with its weight in eq. (14)."""

    name: str
    target: float
    weight: float
    unit: str
    title: str


@dataclass(frozen=True)
class Protocol:
    """The contents of a protocol file, checked and typed; ``raw`` is the file as parsed."""

    name: str
    benchmark: str
    description: str
    grid: tuple[Configuration, ...]
    tests: tuple[Test, ...]
    criteria: tuple[Criterion, ...]
    reference: Mapping[str, float]
    raw: Mapping[str, Any]

    @property
    def sample_time(self) -> Fraction:
        """T_s [s]."""
        return seconds(self.raw["loop"]["sample_time"])

    def test(self, name: str) -> Test:
        """The test called ``name``; raises :class:`InputError` with the names there are."""
        for test in self.tests:
            if test.name == name:
                return test
        raise InputError(
            f"The protocol {self.name} has no test {name}. It has: {', '.join(test.name for test in self.tests)}."
        )


def names() -> tuple[str, ...]:
    """The protocols that come with the benchmark."""
    return tuple(sorted(file.name[: -len(".toml")] for file in FILES.iterdir() if file.name.endswith(".toml")))


def load(name: str) -> Protocol:
    """The protocol called ``name``; raises :class:`InputError` where there is none."""
    if name not in names():
        raise InputError(f"There is no protocol {name}. Choose one of: {', '.join(names())}.")
    raw = tomllib.loads((FILES / f"{name}.toml").read_text(encoding="utf-8"))
    if "extends" in raw:
        raw = _merged(load(raw["extends"]).raw, raw)
    return Protocol(
        name=raw["name"],
        benchmark=raw["benchmark"],
        description=raw["description"],
        grid=_grid(raw),
        tests=tuple(_test(entry) for entry in raw["tests"]),
        criteria=tuple(Criterion(name=key, **entry) for key, entry in raw["criteria"].items()),
        reference=raw["reference"],
        raw=raw,
    )


def cases(
    protocol: Protocol, nominal: Mapping[str, float], seed: int, sample_time: Fraction | None = None
) -> tuple[Case, ...]:
    """All cases, configuration by configuration. ``nominal`` are the plant's start values by FMI name.

    ``sample_time`` [s] is the controller's where it differs from the protocol's; the sensor's noise, a property of its
    own, stays what it is.

    Random draws and noise depend on (seed, configuration, system) alone: every controller meets the same systems,
    disturbances and noise, and every test of a system the same noise.
    """
    found = tuple(
        case(protocol, configuration, system(protocol, nominal, seed, configuration.index, name, test), test, seed)
        for configuration in protocol.grid
        for test in protocol.tests
        for name in protocol.raw[test.systems]["systems"]
    )
    if sample_time is None:
        return found
    return tuple(replace(case, scenario=replace(case.scenario, sample_time=sample_time)) for case in found)


def configuration(protocol: Protocol, q_a1: float, q_a2: float) -> Configuration:
    """The pose (q_a1, q_a2) [rad], with the grid's index where it is a grid point and -1 elsewhere.

    Raises :class:`InputError` outside the workspace.
    """
    for name, value in (("q_a1", q_a1), ("q_a2", q_a2)):
        low, high = protocol.raw["workspace"][f"{name}_deg"]
        if not low - 1e-9 <= math.degrees(value) <= high + 1e-9:
            raise InputError(
                f"{name} = {math.degrees(value):g} deg is outside the workspace. "
                f"Choose a value from {low:g} to {high:g} deg."
            )
    for point in protocol.grid:
        if math.isclose(point.q_a1, q_a1, abs_tol=1e-9) and math.isclose(point.q_a2, q_a2, abs_tol=1e-9):
            return point
    return Configuration(-1, q_a1, q_a2)


def system(protocol: Protocol, nominal: Mapping[str, float], seed: int, index: int, name: str, test: Test) -> System:
    """The system ``name`` of configuration ``index``; ``random_1``, ``random_2``, ... are drawn.

    Systems in performance tests draw their disturbance; those in stability tests have the fixed one.
    """
    raw = protocol.raw
    stream = stable_stream(_seed_words(seed, index, name, DRAWS))
    deviations: dict[str, tuple[float, float]]
    if re.fullmatch(r"random_[1-9]\d*", name):
        draws = {symbol: stream.uniform(-1.0, 1.0, 2) for symbol in raw["uncertainty"]}
        deviations = {symbol: (float(pair[0]), float(pair[1])) for symbol, pair in draws.items()}
    elif name in raw["systems"]:
        deviations = {symbol: (sign, sign) for symbol, sign in raw["systems"][name].items()}
    else:
        known = (*raw["systems"], "random_1", "random_2", "...")
        raise InputError(f"The protocol {protocol.name} has no system {name}. It has: {', '.join(known)}.")
    parameters = {name: value for name, value in nominal.items() if not name.startswith("q_a_start")}
    for symbol, pair in deviations.items():
        for axis, deviation in zip((1, 2), pair, strict=True):
            parameters[f"{symbol}[{axis}]"] *= 1.0 + raw["uncertainty"][symbol] * deviation
    if test.systems == "performance":
        disturbance = _drawn(raw["disturbance"], stream)
    else:
        disturbance = Disturbance(**raw["fixed_disturbance"])
    return System(name, tuple(parameters.items()), disturbance)


def case(protocol: Protocol, configuration: Configuration, system: System, test: Test, seed: int) -> Case:
    """The case of a configuration, a system and a test: everything its simulation needs."""
    loop, raw = protocol.raw["loop"], protocol.raw["disturbance"]
    sample_time, delay = protocol.sample_time, seconds(loop["delay"])
    limit = tuple(loop["torque_limit"])
    disturbance = system.disturbance
    on_axis = [test.axis == axis for axis in (1, 2)]
    force = raw["force"]
    scenario = Scenario(
        parameters=(
            ("q_a_start[1]", configuration.q_a1),
            ("q_a_start[2]", configuration.q_a2),
            *system.parameters,
        ),
        duration=test.duration,
        sample_time=sample_time,
        sensor=Sensor(
            noise=Noise(
                sigma=math.sqrt(loop["noise_power"] / sample_time),
                seed=_seed_words(seed, configuration.index, system.name, NOISE),
            ),
            quantum=math.radians(loop["angle_range_deg"]) / 2 ** loop["angle_bits"],
        ),
        drive=Drive(
            gain=(test.gain if on_axis[0] else 1.0, test.gain if on_axis[1] else 1.0),
            limit=(limit[0], limit[1]),
            quantum=(2 * limit[0] / 2 ** loop["torque_bits"], 2 * limit[1] / 2 ** loop["torque_bits"]),
            delay=(delay + test.delay * on_axis[0], delay + test.delay * on_axis[1]),
        ),
        abort_distance=loop["abort_distance"],
        longest_hold=sample_time,
    )
    if test.disturbed:
        scenario = replace(
            scenario,
            chirp=Chirp(
                amplitude=tuple(raw["chirp_amplitude"]),
                start=disturbance.t_3,
                stop=raw["t_4"],
                f_start=disturbance.f_start,
                f_stop=disturbance.f_stop,
            ),
            pulse=Pulse(
                force=(force * math.cos(disturbance.phi_F), force * math.sin(disturbance.phi_F)),
                start=raw["t_1"],
                stop=raw["t_2"],
            ),
        )
    return Case(configuration, system, test, scenario)


def _merged(base: Mapping[str, Any], changes: Mapping[str, Any]) -> dict[str, Any]:
    """``base`` with ``changes`` on top, tables merged key by key."""
    merged = dict(base)
    for key, value in changes.items():
        both_tables = isinstance(value, Mapping) and isinstance(merged.get(key), Mapping)
        merged[key] = _merged(merged[key], value) if both_tables else value
    return merged


def _grid(raw: Mapping[str, Any]) -> tuple[Configuration, ...]:
    def axis(name: str) -> np.ndarray:
        low, high = raw["workspace"][f"{name}_deg"]
        return np.radians(np.linspace(low, high, raw["grid"][f"{name}_points"]))

    axes = (axis("q_a1"), axis("q_a2"))
    return tuple(Configuration(k, float(q_a1), float(q_a2)) for k, (q_a1, q_a2) in enumerate(product(*axes)))


def _test(entry: Mapping[str, Any]) -> Test:
    exact = {key: seconds(entry[key]) for key in ("duration", "delay") if key in entry}
    lists = {key: tuple(entry[key]) for key in ("criteria", "requirements") if key in entry}
    return Test(**{**entry, **exact, **lists})


def _drawn(raw: Mapping[str, Any], stream: np.random.RandomState) -> Disturbance:
    phi_F = float(stream.uniform(0.0, 2.0 * math.pi))
    t_3 = float(stream.uniform(*raw["t_3_range"]))
    low, high = raw["chirp_frequencies"]
    f_start, f_stop = (low, high) if stream.uniform() < 0.5 else (high, low)
    return Disturbance(phi_F, t_3, f_start, f_stop)


def _seed_words(seed: int, index: int, name: str, purpose: int) -> tuple[int, ...]:
    """Words of a seed sequence. A checksum stands for the name, so that a protocol may list systems in any order."""
    return (seed, index + 1, zlib.crc32(name.encode()), purpose)
