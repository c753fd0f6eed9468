"""The search itself: from each target's worst member so far, eight changed ones in every round.

A (1 + 8) evolution strategy over signs, pose and disturbance. It compares severities and nothing else, its rounds have
a fixed size, and its random numbers depend on seed and target alone: the answer is the same for any number of
processes.
"""

from __future__ import annotations

import math
import zlib
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..benchmark.protocol import Protocol
from ..loop.random_streams import stable_stream
from .history import Asking, History
from .member import Member, loose, names, symbol_of
from .target import Target, severity

CHILDREN = 8
"""Members per target and round."""

SECOND = 0.25
"""Share of the children that have two signs turned instead of one."""
MOVES = 0.4
"""Share of the children that move the pose, or the force."""
JUMPS = 0.3
"""Share of the moves that go anywhere."""
POSE_STEP, FORCE_STEP = 20.0, 30.0
"""Standard deviation of the largest moves [degrees]; each is scaled by a uniform draw, so that there are small ones."""


def children(member: Member, protocol: Protocol, stream: np.random.RandomState) -> list[Member]:
    """Eight members near ``member``: some signs turned, sometimes another pose or disturbance."""
    return [_child(member, protocol, stream) for _ in range(CHILDREN)]


def _child(member: Member, protocol: Protocol, stream: np.random.RandomState) -> Member:
    flips = 2 if stream.uniform() < SECOND else 1
    turned = set(stream.permutation(len(member.deviations))[:flips].tolist())
    signs = stream.choice((-1.0, 1.0), len(member.deviations))
    deviations = tuple(
        (name, (-value or float(signs[place])) if place in turned else value)
        for place, (name, value) in enumerate(member.deviations)
    )
    child = replace(member, deviations=deviations)
    if stream.uniform() < MOVES:
        child = replace(child, q_a=_moved(member.q_a, protocol, stream))
    if protocol.test(member.test).criteria and stream.uniform() < MOVES:
        child = _disturbed(child, protocol, stream)
    return child


def _moved(q_a: tuple[float, float], protocol: Protocol, stream: np.random.RandomState) -> tuple[float, float]:
    """Another pose [degrees], whole numbers; half of the jumps go to where gravity does not load the second gear."""
    jump, stretch = stream.uniform(size=2)
    found = []
    for angle, (low, high) in zip(q_a, (protocol.workspace.q_a1_deg, protocol.workspace.q_a2_deg), strict=True):
        anywhere, near = stream.uniform(low, high), angle + POSE_STEP * stream.standard_normal() * stream.uniform()
        found.append(float(np.clip(round(anywhere if jump < JUMPS else near), low, high)))
    if jump < JUMPS and stretch < 0.5:
        found[1] = -90.0
    return found[0], found[1]


def _disturbed(member: Member, protocol: Protocol, stream: np.random.RandomState) -> Member:
    """Another direction of the force, whole degrees, or the other sweep."""
    low, high = protocol.disturbance.chirp_frequencies
    turn, angle = stream.uniform(), stream.uniform(0.0, 180.0)
    step = FORCE_STEP * stream.standard_normal() * stream.uniform()
    before = math.degrees(member.phi_F) if member.phi_F is not None else 0.0
    if turn < JUMPS:
        return replace(member, sweep=(high, low) if member.sweep == (low, high) else (low, high))
    return replace(member, phi_F=math.radians(round(angle if turn < 2 * JUMPS else before + step)))


def single_effects(member: Member, protocol: Protocol) -> dict[tuple[str, float], Member]:
    """Members that differ from ``member`` in one uncertain parameter, both axes at once, at either end."""
    found = {}
    for symbol in protocol.uncertainty:
        for sign in (-1.0, 1.0):
            changed = {f"{symbol}[{axis}]": sign for axis in (1, 2)}
            deviations = tuple((name, changed.get(name, value)) for name, value in member.deviations)
            found[symbol, sign] = replace(member, deviations=deviations)
    return found


def climb(
    history: History, wanted: Sequence[Target], budget: int, seed: int, note: Callable[[str], Asking[bool]]
) -> Asking[None]:
    """Search for all ``wanted`` targets at once for ``budget`` simulations, beginning with what ``history`` holds;
    ``note`` is asked after each round whether to go on."""
    protocol, begin = history.protocol, len(history.found)
    streams = {target: stable_stream((seed, zlib.crc32(target.name.encode()))) for target in wanted}
    number = 0
    while len(history.found) - begin + CHILDREN * len(wanted) <= budget:
        parents = {target: parent for target in wanted if (parent := history.worst(target)) is not None}
        generation = [
            child
            for target, parent in parents.items()
            for child in children(loose(parent, protocol), protocol, streams[target])
        ]
        yield from history.results(generation)
        number += 1
        if not generation or not (yield from note(f"round {number}")):
            return


def explored(protocol: Protocol) -> int:
    """Simulations of :func:`explore`."""
    return 2 * len(protocol.uncertainty) + 2


def explore(history: History, target: Target, start: Member) -> Asking[None]:
    """The first two steps of a search without a list: each parameter alone at both ends, then all at the worse."""
    protocol = history.protocol
    alone = single_effects(start, protocol)
    results = yield from history.results([start, *alone.values()])
    severities = dict(zip(alone, (severity(target, result, protocol.stability) for result in results[1:]), strict=True))
    worse = {symbol: max((-1.0, 1.0), key=lambda sign: severities[symbol, sign]) for symbol in protocol.uncertainty}
    deviations = tuple((name, worse[symbol_of(name)]) for name in names(protocol))
    yield from history.results([replace(start, deviations=deviations)])
