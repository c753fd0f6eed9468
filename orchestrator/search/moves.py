"""Random changes of a member: the moves of a search. Each is a function of its stream of random numbers alone."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.protocol import Protocol
from .member import Member, Pair, names, symbol_of

MORE = 0.45
"""Probability of each sign turned after the first."""

MOST = 4
"""Signs that are turned at the most."""

FORCE_STEP, POSE_STEP = 25.0, 20.0
"""Standard deviation of the largest moves [degrees]; each is scaled by a uniform draw, so that there are small ones."""

BESIDE_ARM = 10.0
"""Largest angle [degrees] between a force along the arm and the lines from the joints to the TCP."""

INSIDE_STEP = 0.5
"""Standard deviation of a step inside the ranges, in half-widths."""

JUMPS = 0.3
"""Share of the moves of a pose that go anywhere."""

SEEDS = 1000
"""Number of the seeds that a realization of the noise is chosen from."""


def turned(member: Member, stream: np.random.RandomState) -> Member:
    """Some signs turned; a parameter that is nominal goes to either end."""
    count = min(int(stream.geometric(1.0 - MORE)), MOST)
    places = set(stream.permutation(len(member.deviations))[:count].tolist())
    ends = stream.choice((-1.0, 1.0), len(member.deviations))
    deviations = (
        (name, (-math.copysign(1.0, value) if value else float(ends[place])) if place in places else value)
        for place, (name, value) in enumerate(member.deviations)
    )
    return replace(member, deviations=tuple(deviations))


def inside(member: Member, stream: np.random.RandomState) -> Member:
    """Some parameters moved inside their ranges, with reflection at the ends."""
    count = min(int(stream.geometric(1.0 - MORE)), MOST)
    places = set(stream.permutation(len(member.deviations))[:count].tolist())
    steps = INSIDE_STEP * stream.standard_normal(len(member.deviations))
    deviations = (
        (name, _reflected(value + float(steps[place]), -1.0, 1.0) if place in places else value)
        for place, (name, value) in enumerate(member.deviations)
    )
    return replace(member, deviations=tuple((name, round(value, 2)) for name, value in deviations))


def _reflected(value: float, low: float, high: float) -> float:
    value = 2.0 * low - value if value < low else 2.0 * high - value if value > high else value
    return min(max(value, low), high)


def crossed(member: Member, other: Member, stream: np.random.RandomState) -> Member:
    """Each parameter of one of the two."""
    theirs = dict(other.deviations)
    kept = stream.uniform(size=len(member.deviations)) < 0.5
    deviations = (
        (name, value if keep else theirs[name]) for keep, (name, value) in zip(kept, member.deviations, strict=True)
    )
    return replace(member, deviations=tuple(deviations))


def at_pose(member: Member, q_a: Pair) -> Member:
    """The member at another pose, with the force's direction turned with the arm's first axis."""
    if member.phi_F is None:
        return replace(member, q_a=q_a)
    return replace(member, q_a=q_a, phi_F=_direction(math.degrees(member.phi_F) + q_a[0] - member.q_a[0]))


def at_pose_by_joint(member: Member, q_a: Pair, joint: int) -> Member:
    """The member at another pose, with the force's direction turned with the line from a joint, 0 or 1, to the TCP."""
    turn = through_joints(q_a)[joint] - through_joints(member.q_a)[joint]
    return replace(member, q_a=q_a, phi_F=_direction(math.degrees((member.phi_F or 0.0) + turn)))


def with_other_force_direction(member: Member, stream: np.random.RandomState) -> Member:
    """The force from another direction, near its own."""
    step = FORCE_STEP * stream.standard_normal() * stream.uniform()
    return replace(member, phi_F=_direction(math.degrees(member.phi_F or 0.0) + step))


def with_any_force_direction(member: Member, stream: np.random.RandomState) -> Member:
    """The force from any direction."""
    return replace(member, phi_F=_direction(stream.uniform(0.0, 360.0)))


def with_force_along_arm(member: Member, stream: np.random.RandomState) -> Member:
    """The force from a direction between the lines from the joints to the TCP, or near them, either way."""
    first, second = map(math.degrees, through_joints(member.q_a))
    apart = _angle_of_lines(second - first)
    share, near = stream.uniform(size=2)
    turn = share * apart + (2.0 * near - 1.0) * BESIDE_ARM + 180.0 * int(stream.randint(2))
    return replace(member, phi_F=_direction(first + turn))


def through_joints(q_a: Pair) -> tuple[float, float]:
    """Directions [rad] along the lines from the joints to the TCP: such a force turns that joint's motor the least."""
    q_a1, q_a2 = map(math.radians, q_a)
    x, z = math.cos(q_a1 + q_a2), -math.sin(q_a1 + q_a2)  # from the second joint, in lengths of its link
    ratio = NOMINAL["l[1]"] / NOMINAL["l[2]"]
    first = math.degrees(math.atan2(ratio * math.cos(q_a1) + z, ratio * math.sin(q_a1) + x))
    return _direction(first), _direction(math.degrees(math.atan2(z, x)))


def is_along_arm(member: Member) -> bool:
    """Whether the force is as :func:`with_force_along_arm` draws it."""
    first, second = map(math.degrees, through_joints(member.q_a))
    low, high = sorted((0.0, _angle_of_lines(second - first)))
    beside = _angle_of_lines(math.degrees(member.phi_F or 0.0) - first)
    return low - BESIDE_ARM <= beside <= high + BESIDE_ARM


def _angle_of_lines(degrees: float) -> float:
    """An angle between two lines, which have no sense, from -90 to 90 degrees."""
    return (degrees + 90.0) % 180.0 - 90.0


def along_arm(q_a: Pair) -> tuple[float, float, float]:
    """The directions [rad] of :func:`through_joints`, and the one in the middle between these lines."""
    first, second = through_joints(q_a)
    apart = _angle_of_lines(math.degrees(second - first))
    return first, _direction(math.degrees(first) + 0.5 * apart), second


def _direction(degrees: float) -> float:
    """A direction of whole degrees [rad], so that a command says it shortly."""
    return math.radians(round(degrees) % 360)


def with_other_sweep(member: Member, protocol: Protocol) -> Member:
    """The other sweep of the chirp."""
    low, high = protocol.disturbance.chirp_frequencies
    return replace(member, sweep=(high, low) if member.sweep == (low, high) else (low, high))


def with_other_chirp_start(member: Member, protocol: Protocol, stream: np.random.RandomState) -> Member:
    """The chirp from another time on, in hundredths of a second."""
    return replace(member, t_3=round(stream.uniform(*protocol.disturbance.t_3_range), 2))


def with_other_noise(member: Member, stream: np.random.RandomState) -> Member:
    """Another realization of the noise."""
    return replace(member, seed=int(stream.randint(SEEDS)))


def moved(member: Member, protocol: Protocol, stream: np.random.RandomState) -> Member:
    """Another pose within the workspace, in tenths of a degree, near its own or anywhere."""
    jump = stream.uniform() < JUMPS
    angles = []
    workspace = protocol.workspace.q_a1_deg, protocol.workspace.q_a2_deg
    for angle, (low, high) in zip(member.q_a, workspace, strict=True):
        anywhere, near = stream.uniform(low, high), angle + POSE_STEP * stream.standard_normal() * stream.uniform()
        angles.append(_reflected(round(float(anywhere if jump else near), 1), low, high))
    return replace(member, q_a=(angles[0], angles[1]))


def single_effects(member: Member, protocol: Protocol) -> dict[tuple[str, float], Member]:
    """Members that differ from ``member`` in one uncertain parameter, both axes at once, at either end."""
    members = {}
    for symbol in protocol.uncertainty:
        for sign in (-1.0, 1.0):
            changed = {f"{symbol}[{axis}]": sign for axis in (1, 2)}
            deviations = tuple((name, changed.get(name, value)) for name, value in member.deviations)
            members[symbol, sign] = replace(member, deviations=deviations)
    return members


def combined(member: Member, worse: dict[str, float], protocol: Protocol) -> Member:
    """The member with each parameter, on both axes, at its ``worse`` end by symbol."""
    return replace(member, deviations=tuple((name, worse[symbol_of(name)]) for name in names(protocol)))


def either(stream: np.random.RandomState, choices: Sequence[tuple[str, float]]) -> str:
    """One of the ``choices``, a name with its probability, which add up to 1."""
    place = stream.uniform()
    for name, share in choices:
        place -= share
        if place < 0.0:
            return name
    return choices[-1][0]
