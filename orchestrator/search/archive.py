"""What has been simulated in a search, in order."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from .member import Member
from .target import Target, height

Ask = Callable[[Sequence[Member]], list[CaseResult]]
"""Simulates members."""


@dataclass(frozen=True)
class Archive:
    """Members with their results; each is simulated once."""

    protocol: Protocol
    ask: Ask
    found: dict[Member, CaseResult] = field(default_factory=dict)

    def results(self, members: Sequence[Member]) -> list[CaseResult]:
        """Results of ``members``, those that are not known simulated."""
        new = list(dict.fromkeys(member for member in members if member not in self.found))
        if new:
            self.found.update(zip(new, self.ask(new), strict=True))
        return [self.found[member] for member in members]

    def heights(self, target: Target) -> Iterator[tuple[float, Member]]:
        """How bad each possible member is for ``target``, of those that it can be read off."""
        for member, result in self.found.items():
            test = self.protocol.test(member.test)
            own = target.criterion in test.criteria if target.criterion else target.test in (test.name, test.repeats)
            if own and member.possible:
                yield height(target, result, self.protocol.stability), member

    def ranked(self, target: Target) -> list[Member]:
        """The members, the worst for ``target`` first; of equals, the first simulated."""
        return [member for _, member in sorted(self.heights(target), key=lambda pair: -pair[0])]

    def worst(self, target: Target) -> Member | None:
        """The worst member for ``target``; None if none was measured."""
        value, member = max(self.heights(target), key=lambda pair: pair[0], default=(-math.inf, None))
        return member if value > -math.inf else None

    def height(self, target: Target) -> float | None:
        """The largest height so far; None if nothing was measured, or a loop was unstable."""
        value = max((value for value, _ in self.heights(target)), default=-math.inf)
        return value if math.isfinite(value) else None
