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

FINE_STEP, FINE_DECADES = 35.0, 2.5
"""Standard deviation of the largest fine steps of the force's direction [degrees], and the decades below it from which
that of a step is drawn."""

WEAK, WEAK_FORCES = 12.0, 5
"""Largest angle [degrees] between a weak force and the direction that loads the joints least, and the number of forces
that a search begins with. In the worst arms known of SteadyLQG it is 2 to 11 (arms/weak.json)."""

MIRRORED = 0.25
"""Share of the forces that are brought to another pose on the other side of that direction."""

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


def at_pose(member: Member, q_a: Pair, stream: np.random.RandomState) -> Member:
    """The member at another pose, with a force as far from the :func:`weakest` direction as its own: along it or
    against it, and on the same side of it or on the other one."""
    aside = math.degrees((member.phi_F or 0.0) - weakest(member.q_a))
    mirrored, against = stream.uniform() < MIRRORED, int(stream.randint(2))
    turn = (-aside if mirrored else aside) + 180.0 * against
    return replace(member, q_a=q_a, phi_F=_direction(math.degrees(weakest(q_a)) + turn, 2))


def with_other_force_direction(member: Member, stream: np.random.RandomState) -> Member:
    """The force from another direction, near its own."""
    step = FORCE_STEP * stream.standard_normal() * stream.uniform()
    return replace(member, phi_F=_direction(math.degrees(member.phi_F or 0.0) + step))


def with_finely_turned_force(member: Member, stream: np.random.RandomState) -> Member:
    """The force from another direction, in hundredths of a degree, by a step of any order of magnitude.

    The worst B6 of a controller that reacts to events can be that of half a degree: a force that moves the arm a little
    more is an event, and one that moves it less leaves less of a ring (arms/weak.json).
    """
    step = FINE_STEP * 10.0 ** stream.uniform(-FINE_DECADES, 0.0) * stream.standard_normal()
    return replace(member, phi_F=_direction(math.degrees(member.phi_F or 0.0) + step, 2))


def with_any_force_direction(member: Member, stream: np.random.RandomState) -> Member:
    """The force from any direction."""
    return replace(member, phi_F=_direction(stream.uniform(0.0, 360.0)))


def with_weak_force(member: Member, stream: np.random.RandomState) -> Member:
    """A force within WEAK of the :func:`weakest` direction, along it or against it."""
    aside, against = stream.uniform(-WEAK, WEAK), int(stream.randint(2))
    return replace(member, phi_F=_direction(math.degrees(weakest(member.q_a)) + aside + 180.0 * against))


def weak_forces(member: Member) -> list[Member]:
    """The member under forces at even distances from WEAK on one side of the :func:`weakest` direction to the other."""
    first = math.degrees(weakest(member.q_a)) - WEAK
    turns = np.linspace(0.0, 2.0 * WEAK, WEAK_FORCES).tolist()
    return [replace(member, phi_F=_direction(first + turn)) for turn in turns]


def is_weak(member: Member) -> bool:
    """Whether the force is as :func:`with_weak_force` draws it."""
    aside = math.degrees((member.phi_F or 0.0) - weakest(member.q_a))
    return abs((aside + 90.0) % 180.0 - 90.0) <= WEAK + 0.5  # directions are rounded


def weakest(q_a: Pair) -> float:
    """The direction [rad], from -pi/2 to pi/2, in which a force on the TCP loads the joints least: the torques are
    J' F with the Jacobian J of eq. (9), and J J' has the smaller eigenvalue there."""
    q_a1, q_a2 = map(math.radians, q_a)
    l_1, l_2 = NOMINAL["l[1]"], NOMINAL["l[2]"]
    x_2, z_2 = -l_2 * math.sin(q_a1 + q_a2), -l_2 * math.cos(q_a1 + q_a2)  # of the TCP, by q_a2
    x_1, z_1 = l_1 * math.cos(q_a1) + x_2, -l_1 * math.sin(q_a1) + z_2  # by q_a1
    strongest = 0.5 * math.atan2(2.0 * (x_1 * z_1 + x_2 * z_2), x_1 * x_1 + x_2 * x_2 - z_1 * z_1 - z_2 * z_2)
    return strongest - math.copysign(0.5 * math.pi, strongest)


def _direction(degrees: float, digits: int = 0) -> float:
    """A direction of whole degrees [rad], so that a command says it shortly, or with further decimal ``digits``."""
    return math.radians(round(degrees, digits) % 360.0)


def with_other_sweep(member: Member, protocol: Protocol) -> Member:
    """The other sweep of the chirp."""
    low, high = protocol.disturbance.chirp_frequencies
    return replace(member, sweep=(high, low) if member.sweep == (low, high) else (low, high))


def with_other_chirp_start(member: Member, protocol: Protocol, stream: np.random.RandomState) -> Member:
    """The chirp from another time on, in hundredths of a second."""
    return replace(member, t_3=round(stream.uniform(*protocol.disturbance.chirp_starts), 2))


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
