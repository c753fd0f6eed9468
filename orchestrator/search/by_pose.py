"""V by pose: each maximum of eq. (14), of one criterion at one configuration, is searched for by itself.

An evolution strategy with a population for each of these peaks. Good members are exchanged between the poses, with a
force as weak as it was. A generation takes short simulations; at the end of each leg the best members are repeated
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
from typing import NamedTuple

import numpy as np

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from ..loop.random_streams import stable_stream
from . import moves
from .history import Asking, History
from .member import Member, Pair, cost
from .short import short
from .target import NICHES, Target, niches, severity

CHILDREN = 4
"""Members per peak and generation."""

EXCHANGED, CROSSED = 0.4, 0.15
"""Shares of the children that come from another pose, as they are or crossed with one of this pose."""

PUSHED, SWEPT, SHIFTED, HEARD = 0.35, 0.1, 0.1, 0.05
"""Shares of the children that get another direction of the force, the other sweep, another begin of the chirp, another
realization of the noise."""

TURNED = 0.5
"""Share of the children at other poses than the configurations' that have signs turned, too."""

WEAKER = 0.12
"""Share of the children that get a force near the direction that loads the joints least."""

INSIDE = 0.2
"""Share of the children whose parameters move inside their ranges."""

NICHE = 0.75
"""Share of the children that come from any niche; the others come from the criterion's own elite."""

NEAR = 30.0
"""Difference of q_a2 [degrees] at which another pose is chosen half as often."""

MEMORY = 3
"""Number of recent generations from which the gain of the next one is estimated."""

HOPE = 0.02
"""Gain in V that a generation has at the least by this: no criterion is given up."""

LATE_SHARE = 0.5
"""Share of what a start spends that a criterion with niches gets at the least: it rises late, and then by much."""

CONFIRMED = 1
"""Members of each peak that are repeated over the whole case at the end of a leg."""

SETTLING, SLOWER, LONGEST = 3.0, 1.5, 1e3
"""Time after the force [s] that B6 is waited for at the least, in shares of the largest B6 known at the pose, and at
the most: no test is as long. It is rounded up to whole seconds, so that few lengths differ."""


ELITE = 6
"""Members that are kept for each maximum."""


class Peak(NamedTuple):
    """The largest value of a criterion at one pose: each maximum of eq. (14) is searched for separately; or, without
    a pose, at the poses of the workspace that are no configuration. ``niche`` is the figure that its elite is chosen
    by: the criterion itself, or one of :func:`.niches`."""

    target: Target
    q_a: Pair | None = None
    niche: int = 0


@dataclass(frozen=True)
class Elites:
    """The best members of each peak, the best first, with their values."""

    by_peak: dict[Peak, list[tuple[float, Member]]] = field(default_factory=dict)

    def take(self, peak: Peak, value: float, member: Member) -> None:
        """Keep ``member`` if it is among the best of its peak."""
        elite = self.by_peak.setdefault(peak, [])
        if value > -math.inf and all(member != other for _, other in elite):
            elite.append((value, member))
            elite.sort(key=lambda pair: -pair[0])  # stable: of equals, the first found
            del elite[ELITE:]

    def members(self, peak: Peak) -> list[Member]:
        """The members of a peak, the best first."""
        return [member for _, member in self.by_peak.get(peak, ())]

    def largest(self, peak: Peak) -> float:
        """The largest value of a peak; 0 if nothing is known."""
        elite = self.by_peak.get(peak)
        return elite[0][0] if elite else 0.0

    def mean(self, target: Target, poses: Sequence[Pair]) -> float:
        """The mean over the poses of the largest values, as in eq. (14) and (15)."""
        return sum(self.largest(Peak(target, q_a)) for q_a in poses) / len(poses)


@dataclass
class Climb:
    """The search of one start: what is known, the ``targets`` that are searched for at which ``poses``, and the share
    of V of each criterion's value, ``weights``. Whole cases are spent up to ``limit``."""

    history: History
    targets: Sequence[Target]
    poses: Sequence[Pair]
    weights: dict[Target, float]
    seed: int
    start: int
    limit: float
    elites: Elites = field(default_factory=Elites)

    def __post_init__(self) -> None:
        self.streams = {
            target: stable_stream((self.seed, self.start, zlib.crc32(target.name.encode()))) for target in self.targets
        }
        self.spent = dict.fromkeys(self.targets, 0.0)
        self.lately: dict[Target, deque[tuple[float, float]]] = {
            target: deque(maxlen=MEMORY) for target in self.targets
        }

    @property
    def protocol(self) -> Protocol:
        """The protocol whose uncertainty is searched."""
        return self.history.protocol


def begin(climb: Climb, target: Target, members: Sequence[Member], share: float = 1.0) -> Asking[list[CaseResult]]:
    """Try ``members`` for a criterion, each at its pose, as far as a ``share`` of what is left to the start lasts, and
    give the results."""
    limit = climb.history.spent + share * (climb.limit - climb.history.spent)
    return (yield from _try(climb, target, [_seen(climb, target, member) for member in members], limit))


def _try(climb: Climb, target: Target, members: Sequence[Member], limit: float) -> Asking[list[CaseResult]]:
    tried, spent = list[Member](), climb.history.spent
    for member in members:
        spent += 0.0 if member in climb.history.result_of else cost(member, climb.protocol)
        if spent <= limit:
            tried.append(member)
    results = yield from climb.history.results(tried)
    for member, result in zip(tried, results, strict=True):
        peak, value = _peak(climb, target, member), severity(target, result, climb.protocol.stability)
        for niche, figure in enumerate((value, *niches(target, result, moves.is_weak(member)))):
            climb.elites.take(peak._replace(niche=niche), figure, member)
    return results


def _seen(climb: Climb, target: Target, member: Member) -> Member:
    """The member in as short a simulation as shows the target: B6 is waited for by what is known at the pose."""
    # Of this pose alone: while all poses waited equally long, members that settled later looked alike.
    largest = climb.elites.largest(_peak(climb, target, member))
    settling = math.ceil(min(max(SETTLING, SLOWER * largest), LONGEST))
    member = replace(member, short=short(climb.protocol, target, settling))
    # B7 is measured before the force: members that differ by its direction alone are one.
    return replace(member, phi_F=0.0) if target.criterion == "B7" else member


def _peak(climb: Climb, target: Target, member: Member) -> Peak:
    return Peak(target, member.q_a if member.q_a in climb.poses else None)


def rise(climb: Climb, limit: float) -> Asking[None]:
    """One generation after the other until ``limit``, in whole cases spent, would be exceeded."""
    while True:
        target = max(climb.targets, key=lambda choice: _promise(climb, choice))
        before, spent = climb.elites.mean(target, climb.poses), climb.history.spent
        children = generation(climb, target)
        if not children or spent + _price(climb, children) > limit:
            return
        yield from _try(climb, target, children, climb.limit)
        price = climb.history.spent - spent
        gain = climb.weights[target] * (climb.elites.mean(target, climb.poses) - before)
        climb.spent[target] += price
        climb.lately[target].append((gain if math.isfinite(gain) else 0.0, max(price, 1e-9)))


def _price(climb: Climb, views: Sequence[Member]) -> float:
    """Whole cases that a generation takes."""
    return sum(cost(member, climb.protocol) for member in views if member not in climb.history.result_of)


def _promise(climb: Climb, target: Target) -> float:
    """Rise of V to be expected of the next generation, per whole case that it costs."""
    lately = climb.lately[target]
    late = target.criterion in NICHES and climb.spent[target] < LATE_SHARE * sum(climb.spent.values())
    if late or not lately:
        return math.inf
    return (HOPE + sum(gain for gain, _ in lately)) / sum(price for _, price in lately)


def generation(climb: Climb, target: Target) -> list[Member]:
    """The children of all peaks of a criterion that the loop is not unstable at already, as short simulations."""
    stream = climb.streams[target]
    peaks = [Peak(target, q_a) for q_a in climb.poses]
    if not any(climb.elites.members(peak) for peak in peaks):
        return []
    # Peak(target), without a pose: the largest value of all need not be at a configuration.
    return [
        _child(climb, peak, stream) if peak.q_a is not None else _anywhere(climb, peak, stream)
        for peak in (*peaks, Peak(target))
        if climb.elites.largest(peak) < math.inf
        for _ in range(CHILDREN)
    ]


def _anywhere(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Member:
    """A member near the best at another pose than those of the configurations, or near the best of all."""
    elite = climb.elites.members(peak)
    if not elite or stream.uniform() < EXCHANGED:
        largest = max((Peak(peak.target, q_a) for q_a in climb.poses), key=climb.elites.largest)
        elite = climb.elites.members(largest)
    child = moves.moved(elite[min(int(stream.exponential(1.2)), len(elite) - 1)], climb.protocol, stream)
    if stream.uniform() < TURNED:
        child = moves.turned(child, stream)
    if stream.uniform() < PUSHED:
        child = moves.with_other_force_direction(child, stream)
    return _seen(climb, peak.target, child)


def _child(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Member:
    criterion = peak.target.criterion
    if stream.uniform() < NICHE:
        peak = _niche(climb, peak, stream)
    elite = climb.elites.members(peak)
    kind = moves.either(stream, (("exchanged", EXCHANGED), ("crossed", CROSSED), ("of this pose", 1.0)))
    if kind == "exchanged" or not elite:
        child = _exchanged(climb, peak, stream)
        seen = _seen(climb, peak.target, child)
        if seen not in climb.history.result_of:
            return seen
    else:
        child = elite[min(int(stream.exponential(1.2)), len(elite) - 1)]
        if kind == "crossed":
            child = moves.crossed(child, climb.elites.members(_neighbour(climb, peak, stream))[0], stream)
    child = moves.inside(child, stream) if stream.uniform() < INSIDE else moves.turned(child, stream)
    push, sweep, noise, shift = stream.uniform(size=4)
    if push < PUSHED:
        # Not from anywhere: with half of B6's new directions like that, V found of RobustLQG was 117.9, not 118.4.
        pushed = moves.with_weak_force if push < WEAKER else moves.with_finely_turned_force
        child = pushed(child, stream)
    if sweep < SWEPT and criterion != "B5":  # which is searched for without a chirp
        child = moves.with_other_sweep(child, climb.protocol)
    # B7 has no force to push with: its children get another begin of the chirp as often as others get a direction.
    if shift < (PUSHED if criterion == "B7" else SHIFTED) and criterion != "B5":
        child = moves.with_other_chirp_start(child, climb.protocol, stream)
    if noise < HEARD:
        child = moves.with_other_noise(child, stream)
    return _seen(climb, peak.target, child)


def _exchanged(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Member:
    """The best of another pose, under a force near that which it has there beside the weakest direction."""
    assert peak.q_a is not None
    best = climb.elites.members(_neighbour(climb, peak, stream))[0]
    return moves.with_finely_turned_force(moves.at_pose(best, peak.q_a, stream), stream)


def _niche(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Peak:
    """One of the peak's niches that has members."""
    peaks = (peak._replace(niche=niche) for niche in range(1 + NICHES.get(peak.target.criterion, 0)))
    choices = [peak for peak in peaks if climb.elites.members(peak)] or [peak]
    return choices[int(stream.randint(len(choices)))]


def _neighbour(climb: Climb, peak: Peak, stream: np.random.RandomState) -> Peak:
    """A peak at another pose of which something is known; this one if there is none."""
    assert peak.q_a is not None
    others = [peak._replace(q_a=q_a) for q_a in (*climb.poses, None) if q_a != peak.q_a]
    best = {other: elite[0] for other in others if (elite := climb.elites.members(other))}
    if not best:
        return peak
    weights = np.array([1.0 / (1.0 + abs(member.q_a[1] - peak.q_a[1]) / NEAR) for member in best.values()])
    place = int(np.searchsorted(np.cumsum(weights / weights.sum()), stream.uniform()).clip(0, len(best) - 1))
    return list(best)[place]


def best(climb: Climb) -> list[Member]:
    """The best members of each peak, as whole cases: what is confirmed next."""
    peaks = [Peak(target, q_a) for q_a in (*climb.poses, None) for target in climb.targets]
    best = (member for peak in peaks for member in climb.elites.members(peak)[:CONFIRMED])
    return list(dict.fromkeys(replace(member, short=None) for member in best))


def learn(climb: Climb, members: Sequence[Member]) -> Asking[None]:
    """Try what whole cases have shown: the member with the largest value of each criterion at each pose, where that is
    larger than all of the elite."""
    for target in climb.targets:
        best_by_pose: dict[Pair, tuple[float, Member]] = {}
        for member in members:
            value = severity(target, climb.history.result_of[member], climb.protocol.stability)
            largest = climb.elites.largest(_peak(climb, target, member))
            if value > max(best_by_pose.get(member.q_a, (-math.inf,))[0], largest):
                best_by_pose[member.q_a] = value, member
        yield from begin(climb, target, [member for _, member in best_by_pose.values()])
