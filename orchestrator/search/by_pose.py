"""V by pose: each maximum of eq. (14), of one criterion at one configuration, is searched for by itself.

An evolution strategy with a population for each of these peaks. Good members are exchanged between the poses, with the
force turned with the arm. A generation takes short simulations; at the end of each leg the best members are repeated
over the whole case, where all criteria count. The next generation is that of the criterion by which V has lately
risen the most for what it costs. The search depends on results, seed and start alone: the answer is the same for any
number of processes.
"""

from __future__ import annotations

import math
import zlib
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from ..loop.random_streams import stable_stream
from . import moves
from .elites import Elites, Peak
from .history import Asking, History
from .member import Member, Pair, cost
from .short import short
from .target import Target, severity

CHILDREN = 4
"""Members per peak and generation."""

EXCHANGED, CROSSED = 0.25, 0.15
"""Shares of the children that come from another pose, as they are or crossed with one of this pose."""

PUSHED, SWEPT, HEARD = 0.35, 0.1, 0.05
"""Shares of the children that get another direction of the force, the other sweep, another realization of the noise."""

TURNED = 0.5
"""Share of the children at other poses than the configurations' that have signs turned, too."""

NEAR = 30.0
"""Difference of q_a2 [degrees] at which another pose is chosen half as often."""

MEMORY = 3
"""Number of recent generations from which the gain of the next one is estimated."""

HOPE = 0.02
"""Gain in V that a generation has at the least by this: no criterion is given up."""

CONFIRMED = 1
"""Members of each peak that are repeated over the whole case at the end of a leg."""

SETTLING, SLOWER, LONGEST = 3.0, 1.5, 1e3
"""Time after the force [s] that B6 is waited for at the least, in shares of the largest B6 known at the pose, and at
the most: no test is as long. It is rounded up to whole seconds, so that few lengths differ."""


@dataclass
class Climb:
    """The search of one start: what is known, what is searched for at which ``poses``, and the share of V of each
    criterion's value, ``weights``. Whole cases are spent up to ``limit``."""

    history: History
    wanted: Sequence[Target]
    poses: Sequence[Pair]
    weights: dict[Target, float]
    seed: int
    start: int
    limit: float
    elites: Elites = field(default_factory=Elites)

    def __post_init__(self) -> None:
        self.streams = {
            target: stable_stream((self.seed, self.start, zlib.crc32(target.name.encode()))) for target in self.wanted
        }
        self.lately: dict[Target, deque[tuple[float, float]]] = {target: deque(maxlen=MEMORY) for target in self.wanted}

    @property
    def protocol(self) -> Protocol:
        """The protocol whose uncertainty is searched."""
        return self.history.protocol


def begin(climb: Climb, target: Target, members: Sequence[Member]) -> Asking[list[CaseResult]]:
    """Try ``members`` for a criterion, each at its pose, as far as the start's share lasts; gives the results."""
    tried, spent = list[Member](), climb.history.spent
    for member in (_seen(climb, target, member) for member in members):
        spent += 0.0 if member in climb.history.found else cost(member, climb.protocol)
        if spent <= climb.limit:
            tried.append(member)
    results = yield from climb.history.results(tried)
    for member, result in zip(tried, results, strict=True):
        value = severity(target, result, climb.protocol.stability)
        climb.elites.take(_peak(climb, target, member), value, member)
    return results


def _seen(climb: Climb, target: Target, member: Member) -> Member:
    """The member in as short a simulation as shows the target: B6 is waited for by what is known at the pose."""
    known = climb.elites.largest(_peak(climb, target, member))
    settling = math.ceil(min(max(SETTLING, SLOWER * known), LONGEST))
    return replace(member, short=short(climb.protocol, target, settling))


def _peak(climb: Climb, target: Target, member: Member) -> Peak:
    return Peak(target, member.q_a if member.q_a in climb.poses else None)


def rise(climb: Climb, limit: float) -> Asking[None]:
    """One generation after the other until ``limit``, in whole cases spent, would be exceeded."""
    while True:
        target = max(climb.wanted, key=lambda each: _promise(climb, each))
        before, spent = climb.elites.mean(target, climb.poses), climb.history.spent
        children = [_seen(climb, target, member) for member in generation(climb, target)]
        price = sum(cost(member, climb.protocol) for member in children if member not in climb.history.found)
        if not children or spent + price > limit:
            return
        yield from begin(climb, target, children)
        gain = climb.weights[target] * (climb.elites.mean(target, climb.poses) - before)
        climb.lately[target].append((gain if math.isfinite(gain) else 0.0, max(price, 1e-9)))


def _promise(climb: Climb, target: Target) -> float:
    """Rise of V to be expected of the next generation, per whole case that it costs."""
    lately = climb.lately[target]
    if not lately:
        return math.inf
    return (HOPE + sum(gain for gain, _ in lately)) / sum(price for _, price in lately)


def generation(climb: Climb, target: Target) -> list[Member]:
    """The children of all peaks of a criterion that the loop is not unstable at already."""
    stream = climb.streams[target]
    peaks = [Peak(target, q_a) for q_a in climb.poses]
    if not any(climb.elites.members(each) for each in peaks):
        return []
    return [
        _child(climb, peak, stream) if peak.q_a is not None else _anywhere(climb, peak, stream)
        for peak in (*peaks, Peak(target))
        if climb.elites.largest(peak) < math.inf
        for _ in range(CHILDREN)
    ]


def _anywhere(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Member:
    """A member near the best at another pose than those of the configurations, or near the best of all."""
    own = climb.elites.members(peak)
    if not own or stream.uniform() < EXCHANGED:
        largest = max((Peak(peak.target, q_a) for q_a in climb.poses), key=climb.elites.largest)
        own = climb.elites.members(largest)
    found = moves.moved(own[min(int(stream.exponential(1.2)), len(own) - 1)], climb.protocol, stream)
    if stream.uniform() < TURNED:
        found = moves.turned(found, stream)
    return moves.with_other_force_direction(found, stream) if stream.uniform() < PUSHED else found


def _child(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Member:
    assert peak.q_a is not None
    own = climb.elites.members(peak)
    kind = moves.either(stream, (("exchanged", EXCHANGED), ("crossed", CROSSED), ("own", 1.0)))
    if kind == "exchanged" or not own:
        found = moves.at_pose(climb.elites.members(_neighbour(climb, peak, stream))[0], peak.q_a)
        if replace(found, short=None) not in {replace(member, short=None) for member in own}:
            return found
    else:
        found = own[min(int(stream.exponential(1.2)), len(own) - 1)]
        if kind == "crossed":
            found = moves.crossed(found, climb.elites.members(_neighbour(climb, peak, stream))[0], stream)
    found = moves.turned(found, stream)
    push, sweep, noise = stream.uniform(size=3)
    if push < PUSHED and peak.target.criterion != "B7":  # which is measured before the force
        found = moves.with_other_force_direction(found, stream)
    if sweep < SWEPT and peak.target.criterion != "B5":  # which is searched for without a chirp
        found = moves.with_other_sweep(found, climb.protocol)
    return moves.with_other_noise(found, stream) if noise < HEARD else found


def _neighbour(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Peak:
    """A peak at another pose of which something is known; this one if there is none."""
    assert peak.q_a is not None
    poses = [q_a for q_a in climb.poses if q_a != peak.q_a and climb.elites.members(Peak(peak.target, q_a))]
    if not poses:
        return peak
    weights = np.array([1.0 / (1.0 + abs(q_a[1] - peak.q_a[1]) / NEAR) for q_a in poses])
    place = int(np.searchsorted(np.cumsum(weights / weights.sum()), stream.uniform()).clip(0, len(poses) - 1))
    return Peak(peak.target, poses[place])


def best(climb: Climb) -> list[Member]:
    """The best members of each peak, as whole cases: what is confirmed next."""
    peaks = [Peak(target, q_a) for q_a in (*climb.poses, None) for target in climb.wanted]
    best = (member for peak in peaks for member in climb.elites.members(peak)[:CONFIRMED])
    return list(dict.fromkeys(replace(member, short=None) for member in best))


def learn(climb: Climb, members: Sequence[Member]) -> Asking[None]:
    """Try what whole cases have shown: the member with the largest value of each criterion at each pose, where that is
    larger than all of the elite."""
    for target in climb.wanted:
        found: dict[Pair, tuple[float, Member]] = {}
        for member in members:
            value = severity(target, climb.history.found[member], climb.protocol.stability)
            known = climb.elites.largest(_peak(climb, target, member))
            if value > max(found.get(member.q_a, (-math.inf,))[0], known):
                found[member.q_a] = value, member
        yield from begin(climb, target, [member for _, member in found.values()])
