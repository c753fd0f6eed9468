"""The best members known for each maximum that a search looks for."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from .member import Member, Pair
from .target import Target

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
