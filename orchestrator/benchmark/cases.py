"""From a protocol to its cases: configurations of the workspace, systems of the uncertainty description, scenarios."""

from __future__ import annotations

import math
import re
import zlib
from collections.abc import Mapping
from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import NamedTuple

import msgspec
import numpy as np

from ..errors import InputError
from ..loop.random_streams import stable_stream
from ..loop.scenario import Chirp, Drive, Noise, Pulse, Recurrence, Scenario, Sensor, force
from .case import Case, Configuration, Disturbance, System, Test
from .protocol import Protocol

DRAWS, NOISE, JITTER = range(3)
"""The purposes of the random streams of a configuration and system."""


class SeedWords(NamedTuple):
    """The words that begin the seed of each stream, in their order: the ``seed`` of the draw, one more than the index
    of the ``pose``, a checksum of the ``system``'s name, so that a protocol may list systems in any order, and the
    ``purpose``. Others may follow."""

    seed: int
    pose: int
    system: int
    purpose: int


def grid(protocol: Protocol, seed: int = 0) -> tuple[Configuration, ...]:
    """The configurations of a protocol; ``seed`` moves them if it has a jitter."""

    def axis(limits: tuple[float, float], points: int) -> list[float]:
        return [float(angle) for angle in np.radians(np.linspace(*limits, points))]

    q_a1 = axis(protocol.workspace.q_a1_deg, protocol.grid.q_a1_points)
    q_a2 = axis(protocol.workspace.q_a2_deg, protocol.grid.q_a2_points)
    listed = [(math.radians(first), math.radians(second)) for first, second in protocol.grid.also_deg]
    poses = (Configuration(k, *angles) for k, angles in enumerate([*product(q_a1, q_a2), *listed]))
    return tuple(_moved(protocol, pose, seed) for pose in poses) if protocol.jitter.pose_deg else tuple(poses)


def _moved(protocol: Protocol, pose: Configuration, seed: int) -> Configuration:
    """``pose``, moved by the protocol's jitter; one beyond an end of the workspace is mirrored there."""
    reach = math.radians(protocol.jitter.pose_deg)
    moves = stable_stream(seed_words(seed, pose.index, "", JITTER)).uniform(-reach, reach, 2)
    angles = []
    for angle, ends in zip(
        moves + (pose.q_a1, pose.q_a2), (protocol.workspace.q_a1_deg, protocol.workspace.q_a2_deg), strict=True
    ):
        low, high = np.radians(ends)
        # Mirrored, not cut: cutting would gather the poses at the ends of the workspace.
        mirrored = 2 * low - angle if angle < low else 2 * high - angle if angle > high else angle
        angles.append(float(np.clip(mirrored, low, high)))
    return Configuration(pose.index, angles[0], angles[1])


def cases(
    protocol: Protocol, nominal: Mapping[str, float], seed: int, sample_time: Fraction | None = None
) -> tuple[Case, ...]:
    """All cases, configuration by configuration. ``nominal`` are the plant's start values by FMI name.

    ``sample_time`` [s] is the controller's if it differs from the protocol's; the sensor's noise, a property of its
    own, stays what it is.

    Random draws and noise depend on (seed, configuration, system) alone: every controller meets the same systems,
    disturbances and noise, and every test of a system the same noise, unless the protocol's jitter is of ``tests``.
    """
    listed = tuple(
        case(protocol, pose, system(protocol, nominal, seed, pose.index, name, test), test, seed)
        for pose in grid(protocol, seed)
        for test in protocol.tests
        if not test.poses or pose.index in test.poses
        for name in protocol.sets[test.systems]
    )
    if sample_time is None:
        return listed
    return tuple(replace(case, scenario=replace(case.scenario, sample_time=sample_time)) for case in listed)


def configuration(protocol: Protocol, q_a1: float, q_a2: float, seed: int = 0) -> Configuration:
    """The pose (q_a1, q_a2) [rad], with the grid's index if it is a grid point and -1 otherwise.

    Raises :class:`InputError` outside the workspace.
    """
    limits = protocol.workspace.q_a1_deg, protocol.workspace.q_a2_deg
    for name, value, (low, high) in zip(("q_a1", "q_a2"), (q_a1, q_a2), limits, strict=True):
        # An end of the workspace, given in radians, may be a rounding beyond it in degrees.
        if not low - 1e-9 <= math.degrees(value) <= high + 1e-9:
            message = f"{name} = {math.degrees(value):g} deg is outside the workspace, {low:g} to {high:g} deg."
            raise InputError(message, "outside-workspace", name, value)
    for point in grid(protocol, seed):
        if math.isclose(point.q_a1, q_a1, abs_tol=1e-9) and math.isclose(point.q_a2, q_a2, abs_tol=1e-9):
            return point
    return Configuration(-1, q_a1, q_a2)


def case_named(protocol: Protocol, nominal: Mapping[str, float], seed: int, id: str) -> Case:
    """The case called ``id``, such as ``c07.compliant.gain_1``, also with another system than the protocol runs.

    Raises :class:`InputError` if the protocol has no such configuration, system or test.
    """
    poses = grid(protocol, seed)
    match = re.fullmatch(r"c(\d+)\.(\w+)\.(\w+)", id)
    if not match or int(match[1]) >= len(poses):
        example = f"c{len(poses) - 1:02d}.{protocol.sets[protocol.tests[0].systems][0]}.{protocol.tests[0].name}"
        message = f"There is no case {id} in the protocol {protocol.name}. Cases are named CONFIGURATION.SYSTEM.TEST, "
        message += f"such as {example}."
        raise InputError(message, "no-case", protocol.name, id)
    test = protocol.test(match[3])
    pose = poses[int(match[1])]
    return case(protocol, pose, system(protocol, nominal, seed, pose.index, match[2], test), test, seed)


def system(protocol: Protocol, nominal: Mapping[str, float], seed: int, index: int, name: str, test: Test) -> System:
    """The system ``name`` of configuration ``index``; ``random_1``, ``random_2``, ... are drawn.

    Whether its disturbance is drawn, too, or listed, the ``test`` says.
    """
    stream = stable_stream(seed_words(seed, index, name, DRAWS))
    deviations: dict[str, tuple[float, float]]
    if re.fullmatch(r"random_[1-9]\d*", name):
        draws = {symbol: stream.uniform(-1.0, 1.0, 2) for symbol in protocol.uncertainty}
        deviations = {symbol: (float(pair[0]), float(pair[1])) for symbol, pair in draws.items()}
    elif name in protocol.systems:
        deviations = {symbol: (sign, sign) for symbol, sign in protocol.systems[name].items()}
        if protocol.jitter.system:
            moves = {symbol: 1.0 - protocol.jitter.system * stream.uniform(0.0, 1.0, 2) for symbol in deviations}
            deviations = {
                symbol: (sign * float(moves[symbol][0]), sign * float(moves[symbol][1]))
                for symbol, (sign, _) in deviations.items()
            }
    else:
        systems = (*protocol.systems, "random_1", "random_2")
        message = f"The protocol {protocol.name} has no system {name}. It has: {', '.join(systems)} and so on."
        raise InputError(message, "no-system", protocol.name, name, systems)
    parameters = {name: value for name, value in nominal.items() if not name.startswith("q_a_start")}
    for symbol, pair in deviations.items():
        for axis, deviation in zip((1, 2), pair, strict=True):
            parameters[f"{symbol}[{axis}]"] *= 1.0 + protocol.uncertainty[symbol] * deviation
    jitter = protocol.jitter
    # Else a controller could learn its disturbance in one test, and use
    # it in the next: with state that passes from case to case.
    if jitter.tests:
        stream = stable_stream((*seed_words(seed, index, name, DRAWS), _checksum(test.name)))
    disturbance = _draw(protocol, stream) if test.draws else _listed(protocol, test)
    if jitter.direction_deg or jitter.force_time:
        turn, late = stream.uniform(-1.0, 1.0, 2) * (math.radians(jitter.direction_deg), jitter.force_time)
        disturbance = msgspec.structs.replace(disturbance, phi_F=float(disturbance.phi_F + turn), late=float(late))
    return System(name, tuple(parameters.items()), disturbance)


def case(protocol: Protocol, configuration: Configuration, system: System, test: Test, seed: int) -> Case:
    """The case of a configuration, a system and a test: everything its simulation needs."""
    loop, rules = protocol.loop, protocol.disturbance
    limit, disturbance = loop.torque_limit, system.disturbance
    on_axis = [test.axis == axis for axis in (1, 2)]
    # No word for the noise number 0: its seed stays that of all versions before the number was there.
    noise_words = (_checksum(test.name),) if protocol.jitter.tests else tuple(filter(None, (test.noise,)))
    scenario = Scenario(
        parameters=(
            ("q_a_start[1]", configuration.q_a1),
            ("q_a_start[2]", configuration.q_a2),
            *system.parameters,
        ),
        duration=test.duration,
        sample_time=loop.sample_time,
        sensor=Sensor(
            noise=Noise(
                # Band-limited white noise: the variance of a sample is P_n / T_s (docs/paper.md).
                sigma=math.sqrt(loop.noise_power / loop.sample_time),
                seed=(*seed_words(seed, configuration.index, system.name, NOISE), *noise_words),
            ),
            quantum=math.radians(loop.angle_range_deg) / 2**loop.angle_bits,
        ),
        drive=Drive(
            gain=(test.gain if on_axis[0] else 1.0, test.gain if on_axis[1] else 1.0),
            limit=limit,
            quantum=(2 * limit[0] / 2**loop.torque_bits, 2 * limit[1] / 2**loop.torque_bits),
            delay=(loop.delay + test.delay * on_axis[0], loop.delay + test.delay * on_axis[1]),
        ),
        abort_distance=loop.abort_distance,
        longest_hold=loop.sample_time,
        stop_time=max(Fraction(protocol.stability.longest), *(other.duration for other in protocol.tests)),
    )
    if test.disturbed:
        phi_F = disturbance.phi_F
        scenario = replace(
            scenario,
            chirp=Chirp(
                amplitude=rules.chirp_amplitude,
                start=disturbance.t_3,
                stop=rules.t_4,
                f_start=disturbance.f_start,
                f_stop=disturbance.f_stop,
            ),
            pulse=Pulse(
                force=force(rules.force, phi_F),
                start=rules.t_1 + disturbance.late,
                stop=rules.t_2 + disturbance.late,
            ),
            again=recurrence(test),
        )
    return Case(configuration, system, test, scenario)


def recurrence(test: Test) -> Recurrence:
    """How often the disturbances of a test come."""
    if test.again is None:
        return Recurrence()
    return Recurrence(test.again.period, test.again.number, math.radians(test.again.turn_deg))


def _listed(protocol: Protocol, test: Test) -> Disturbance:
    fixed = protocol.fixed_disturbance
    phi_F = fixed.phi_F if test.direction_deg is None else math.radians(test.direction_deg)
    low, high = protocol.disturbance.chirp_frequencies
    sweeps = {"up": (low, high), "down": (high, low)}
    f_start, f_stop = sweeps.get(test.sweep, (fixed.f_start, fixed.f_stop))
    return Disturbance(phi_F=phi_F, t_3=fixed.t_3, f_start=f_start, f_stop=f_stop)


def _draw(protocol: Protocol, stream: np.random.RandomState) -> Disturbance:
    # The order of the draws is part of the benchmark: another one gives other systems for the same seed.
    phi_F = float(stream.uniform(0.0, 2.0 * math.pi))
    t_3 = float(stream.uniform(*protocol.disturbance.t_3_range))
    low, high = protocol.disturbance.chirp_frequencies
    f_start, f_stop = (low, high) if stream.uniform() < 0.5 else (high, low)
    return Disturbance(phi_F=phi_F, t_3=t_3, f_start=f_start, f_stop=f_stop)


def seed_of(case: Case) -> int:
    """The seed that a case was made with."""
    return SeedWords(*case.scenario.sensor.noise.seed[: len(SeedWords._fields)]).seed


def seed_words(seed: int, index: int, name: str, purpose: int) -> SeedWords:
    """The words for the pose with an ``index``, -1 off the grid, and the system of this ``name``."""
    return SeedWords(seed, index + 1, _checksum(name), purpose)


def _checksum(name: str) -> int:
    # Not hash(), which Python salts anew in each process.
    return zlib.crc32(name.encode(errors="surrogateescape"))  # a word of a command line may hold bytes of no text
