"""A search for the worst case: its budget, what it has found, and its path.

The budget, in whole cases of simulated time, is spent in this order: the protocol's list, V by pose, its noise,
failures in the loop as it is, the effect of each parameter, margins, the noise of what fails, radius. Each stage has a
share of what is left, and what it does not need goes to the next. Every decision looks at results alone, so the answer
is the same for any number of processes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from ..benchmark.protocol import Protocol
from ..benchmark.results import Rules, Scorecard
from ..benchmark.scorecard import score
from .findings import Step
from .history import Asking, History
from .member import Member, Pair, cost
from .member import possible as asked_for
from .target import Target

CONFIRMED = 0.25
"""Share of what is left that each of the stages after V by pose may take that need some dozens of cases."""


@dataclass
class Hunt:
    """A search: what is known, the members of the protocol's list, the ``poses`` of its configurations, the
    ``targets``, and how a member's case is repeated. V by pose is searched for from ``restarts`` independent starts,
    and, if it is to, from the arms ``known`` of other controllers.

    ``shown`` are the members that a report shows, and as the worst of what: ``B6``, ``A2 1``, ``A3 delay_2``.
    ``starts`` is V found by each start. ``budget`` is in whole cases; ``cut`` is whether a share of the present stage
    did not last.
    """

    history: History
    rules: Rules
    listed: Sequence[Member]
    poses: Sequence[Pair]
    targets: Sequence[Target]
    command: Callable[[Member], str]
    budget: float
    restarts: int = 1
    known: bool = False
    path: list[Step] = field(default_factory=list)
    shown: dict[Member, list[str]] = field(default_factory=dict)
    starts: list[float | None] = field(default_factory=list)
    complete: bool = True
    cut: bool = False
    cut_short: list[str] = field(default_factory=list)

    @property
    def protocol(self) -> Protocol:
        """The protocol whose uncertainty is searched."""
        return self.history.protocol

    def share(self, part: float) -> Share:
        """A part of what is left of the budget."""
        return Share(self, part * (self.budget - self.history.spent))

    def note(self, stage: str) -> Asking[bool]:
        """Write down what is known at the end of a stage; asks, and returns, whether to go on."""
        if self.cut:
            self.cut_short.append(stage)
        self.cut = False
        worst = {target.name: self.history.severity(target) for target in self.targets}
        cost_found = card(self, possible(self)).cost
        self.path.append(Step(stage, len(self.history.result_of), self.history.spent, cost_found, worst))
        goes_on: bool = yield self.path[-1]
        self.complete = self.complete and goes_on
        return self.complete


@dataclass
class Share:
    """What a stage may spend, of which so many whole cases are ``left``. Stages side by side have one each."""

    hunt: Hunt
    left: float

    def afford(self, members: Sequence[Member]) -> list[Member]:
        """Those of ``members`` that the share lasts for: all that are known, and the first of the others, which it pays
        for."""
        dropped = set[Member]()
        for member in dict.fromkeys(members):
            if member not in self.hunt.history.result_of:
                price = cost(member, self.hunt.protocol)
                if dropped or price > self.left:
                    dropped.add(member)
                else:
                    self.left -= price
        self.hunt.cut = self.hunt.cut or bool(dropped)
        return [member for member in members if member not in dropped]


def least(protocol: Protocol, listed: Sequence[Member], targets: Sequence[Target]) -> float:
    """Whole cases that a search begins with: the list, or each parameter alone."""
    if listed:
        return sum(cost(member, protocol) for member in listed)
    return float(len(targets) * (2 * len(protocol.uncertainty) + 2))


def card(hunt: Hunt, members: Sequence[Member]) -> Scorecard:
    """The scorecard of those of ``members`` that stand at a configuration of the protocol."""
    # Poses between the configurations have the index -1: the means of Table 2 and eq. (14) are over those alone.
    results = (hunt.history.result_of[member] for member in members)
    return score(hunt.rules, [result for result in results if result.configuration.index >= 0])


def possible(hunt: Hunt) -> list[Member]:
    """The members that count: within Table 1, as whole cases, in a loop that their test asks for."""
    return [member for member in hunt.history.result_of if asked_for(member, hunt.protocol)]
