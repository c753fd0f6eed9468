"""What has been simulated in a search, in order."""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field
from itertools import chain
from typing import Any, TypeVar

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult
from .findings import Step
from .member import Member, cost, possible
from .target import Target, severity

T = TypeVar("T")


@dataclass(frozen=True)
class Ask:
    """Asks for the results of ``members``, in their order."""

    members: tuple[Member, ...]


Asking = Generator[Ask | Step, Any, T]
"""What asks for simulations, and is sent their results; and tells each stage, and is sent whether to go on."""


def side_by_side(parts: Sequence[Asking[T]]) -> Asking[list[T]]:
    """What ``parts`` of a stage return, in their order. What they ask for next is asked for together, so that
    processors do not wait for one part's last simulation."""
    returned: dict[int, T] = {}
    replies: dict[int, Any] = dict.fromkeys(range(len(parts)))
    while replies:
        asked = {}
        for number, reply in replies.items():
            try:
                request = parts[number].send(reply)
            except StopIteration as end:
                returned[number] = end.value
            else:
                assert isinstance(request, Ask)  # a part of a stage does not end it
                asked[number] = request.members
        every = tuple(dict.fromkeys(chain.from_iterable(asked.values())))
        results = dict(zip(every, (yield Ask(every)), strict=True)) if every else {}
        replies = {number: [results[member] for member in members] for number, members in asked.items()}
    return [returned[number] for number in range(len(parts))]


@dataclass
class History:
    """Members with the ``result_of`` each, which is simulated once. ``spent`` is what they took, in whole cases."""

    protocol: Protocol
    result_of: dict[Member, CaseResult] = field(default_factory=dict)
    spent: float = 0.0

    def results(self, members: Sequence[Member]) -> Asking[list[CaseResult]]:
        """Results of ``members``; asks for those that are not known."""
        new = tuple(dict.fromkeys(member for member in members if member not in self.result_of))
        if new:
            results: Sequence[CaseResult] = yield Ask(new)
            # What runs beside this may have asked for one of them, too.
            self.spent += sum(cost(member, self.protocol) for member in new if member not in self.result_of)
            self.result_of.update(zip(new, results, strict=True))
        return [self.result_of[member] for member in members]

    def severities(self, target: Target) -> Iterator[tuple[float, Member]]:
        """How bad each possible member is for ``target``, of those that it can be read off."""
        for member, result in self.result_of.items():
            test = self.protocol.test(member.test)
            # A test that repeats another with other noise counts for that one, too.
            shows = target.criterion in test.criteria if target.criterion else target.test in (test.name, test.repeats)
            if shows and possible(member, self.protocol):
                yield severity(target, result, self.protocol.stability), member

    def ranked(self, target: Target) -> list[Member]:
        """The members, the worst for ``target`` first; of equals, the first simulated."""
        return [member for _, member in sorted(self.severities(target), key=lambda pair: -pair[0])]

    def worst(self, target: Target) -> Member | None:
        """The worst member for ``target``; None if none was measured."""
        value, member = max(self.severities(target), key=lambda pair: pair[0], default=(-math.inf, None))
        return member if value > -math.inf else None

    def severity(self, target: Target) -> float | None:
        """The largest severity so far; None if nothing was measured, or a loop was unstable."""
        value = max((value for value, _ in self.severities(target)), default=-math.inf)
        return value if math.isfinite(value) else None
