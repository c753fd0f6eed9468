"""The stages of a search for the worst case up to its margins, and what they find.

The budget is spent in this order: the protocol's list, a search from its worst cases, the worst members at all
configurations, the noise of what fails, the effect of each parameter, margins, radius. Each stage has a share of what
is left, and what it does not need goes to the next. Every decision looks at results alone, so the answer is the same
for any number of processes.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, Rules, Scorecard
from ..benchmark.scorecard import kind, score
from .ascent import climb, explore, explored
from .findings import (
    ConfigurationFound,
    CriterionFound,
    Effect,
    Found,
    RequirementFound,
    Step,
)
from .history import Asking, History
from .member import Member, Pair, loose, names
from .target import Target, fails

SEEDS = range(1, 9)
"""Base seeds of the noise that a failure is tried with."""

SEARCHED, SEARCHED_ALONE = 0.35, 0.7
"""Share of what the list leaves of the budget that the search takes, and of the whole one where there is no list."""

CONFIRMED = 0.25
"""Share of what is left that each of the next stages may take, which need some dozens."""


@dataclass
class Hunt:
    """A search: what is known, the members of the protocol's list, what is wanted, and how a member's case is repeated.
    ``shown`` are the members that a report shows, and as the worst of what: ``B6``, ``A2 1``, ``A3 delay_2``.
    ``limit`` is the number of simulations at which the stage's share of the ``budget`` ends."""

    history: History
    rules: Rules
    listed: Sequence[Member]
    wanted: Sequence[Target]
    command: Callable[[Member], str]
    budget: int
    path: list[Step] = field(default_factory=list)
    shown: dict[Member, list[str]] = field(default_factory=dict)
    complete: bool = True
    limit: int = 0
    cut: bool = False
    cut_short: list[str] = field(default_factory=list)

    @property
    def protocol(self) -> Protocol:
        """The protocol whose uncertainty is searched."""
        return self.history.protocol

    def allot(self, share: float) -> None:
        """Give the next stage a share of what is left of the budget."""
        spent = len(self.history.found)
        self.limit = spent + int(share * (self.budget - spent))

    def afford(self, members: Sequence[Member]) -> list[Member]:
        """Those of ``members`` that the stage's share lasts for: all that are known, and the first of the others."""
        known = self.history.found
        new = [member for member in dict.fromkeys(members) if member not in known]
        dropped = set(new[max(0, self.limit - len(known)) :])
        self.cut = self.cut or bool(dropped)
        return [member for member in members if member not in dropped]

    def note(self, stage: str) -> Asking[bool]:
        """Write down what is known at the end of a stage; asks, and returns, whether to go on."""
        if self.cut:
            self.cut_short.append(stage)
        self.cut = False
        worst = {target.name: self.history.severity(target) for target in self.wanted}
        self.path.append(Step(stage, len(self.history.found), worst))
        goes_on: bool = yield self.path[-1]
        self.complete = self.complete and goes_on
        return self.complete


def least(protocol: Protocol, listed: Sequence[object], wanted: Sequence[Target]) -> int:
    """Simulations that a search begins with: the list, or each parameter alone."""
    return len(listed) or len({target.test for target in wanted}) * explored(protocol)


def search(hunt: Hunt, seed: int) -> Asking[None]:
    """Simulate the list, then climb from its worst cases; without a list, from the nominal system."""
    history, wanted = hunt.history, hunt.wanted
    yield from history.results(hunt.listed)
    if not hunt.listed:
        start = Member((0.0, -90.0), "", tuple((name, 0.0) for name in names(hunt.protocol)))
        for target in {target.test: target for target in wanted}.values():
            yield from explore(history, target, replace(start, test=target.test))
    share = SEARCHED if hunt.listed else SEARCHED_ALONE
    if (yield from hunt.note("list" if hunt.listed else "each parameter alone")):
        yield from climb(history, wanted, int(share * (hunt.budget - len(history.found))), seed, hunt.note)


def all_configurations(hunt: Hunt) -> Asking[None]:
    """The worst members of the heaviest criteria at every configuration: eq. (14) wants the maximum at each."""
    poses = dict.fromkeys(member.q_a for member in hunt.listed)
    hunt.allot(CONFIRMED)
    yield from hunt.history.results(
        hunt.afford([replace(member, q_a=q_a) for member in worst_members(hunt).values() for q_a in poses])
    )
    yield from hunt.note("all configurations")


def worst_members(hunt: Hunt) -> dict[Target, Member]:
    """The criteria that are searched for, and the worst member of each."""
    found = ((target, hunt.history.worst(target)) for target in hunt.wanted if target.criterion)
    return {target: loose(member, hunt.protocol) for target, member in found if member is not None}


def worst_at_each(hunt: Hunt) -> list[Member]:
    """The worst member of each criterion that is searched for at each configuration of the list."""
    poses = {member.q_a for member in hunt.listed}
    found: dict[tuple[Target, Pair], tuple[float, Member]] = {}
    for target in hunt.wanted:
        for value, member in hunt.history.severities(target) if target.criterion else ():
            at = target, member.q_a
            if member.q_a in poses and (at not in found or value > found[at][0]):
                found[at] = value, member
    return list(dict.fromkeys(loose(member, hunt.protocol) for _, member in found.values()))


def card(hunt: Hunt, members: Sequence[Member]) -> Scorecard:
    """The scorecard of those of ``members`` that stand at a configuration of the protocol."""
    results = (hunt.history.found[member] for member in members)
    return score(hunt.rules, [result for result in results if result.configuration.index >= 0])


def _possible(hunt: Hunt) -> list[Member]:
    return [member for member in hunt.history.found if member.possible]


def criteria(hunt: Hunt) -> dict[str, CriterionFound]:
    """The criteria with the largest values found."""
    found, listed = card(hunt, _possible(hunt)), card(hunt, hunt.listed)
    entries = {}
    for name, spec in hunt.protocol.criteria.items():
        target = Target(name, "", name)
        worst = hunt.history.worst(target)
        where = Found(None, "") if worst is None else Found(hunt.history.severity(target), hunt.command(worst))
        if worst is not None and name in {each.criterion for each in hunt.wanted}:
            hunt.shown.setdefault(worst, []).append(name)
        entries[name] = CriterionFound(found.criteria[name].value, listed.criteria[name].value, spec.unit, where)
    return entries


def costs(hunt: Hunt) -> tuple[float | None, float | None]:
    """V of eq. (15) with all that was found, and of the list alone."""
    return card(hunt, _possible(hunt)).cost, card(hunt, hunt.listed).cost


def configurations(hunt: Hunt) -> tuple[ConfigurationFound, ...]:
    """V_k of the list, and with all that was found."""
    listed = {entry.index: entry.cost for entry in card(hunt, hunt.listed).configurations}
    found = card(hunt, _possible(hunt)).configurations
    return tuple(
        ConfigurationFound(entry.index, entry.q_a1, entry.q_a2, listed[entry.index], entry.cost)
        for entry in found
        if entry.index in listed
    )


def requirements(hunt: Hunt) -> Asking[dict[str, RequirementFound]]:
    """The requirements, each with the worst case found, which is tried with other noise where it fails."""
    protocol = hunt.protocol
    found = {}
    hunt.allot(CONFIRMED)
    for name in ("A1", "A2", "A3"):
        tests = [test for test in protocol.tests if name in test.requirements and not test.repeats]
        members = [
            (value, member) for test in tests for value, member in hunt.history.severities(Target(test.name, test.name))
        ]
        if members:
            known, limits = hunt.history.found, protocol.stability
            # A simulation that crashed has no severity, but fails all the same.
            _, worst = max(members, key=lambda pair: (fails(known[pair[1]], limits), pair[0]))
            found[name] = yield from _judged(hunt, worst, all(known[member].judged for _, member in members))
            test = protocol.test(worst.test)
            if known[worst].simulated:
                hunt.shown.setdefault(worst, []).append(f"{name} {test.name if name == 'A3' else test.axis}")
    yield from hunt.note("other noise")
    return found


def _judged(hunt: Hunt, worst: Member, whole: bool) -> Asking[RequirementFound]:
    """What is known of a requirement by its worst case, if the ``whole`` of its simulations says something."""
    limits = hunt.protocol.stability
    (result,) = yield from hunt.history.results([worst])
    broken = fails(result, limits)
    failed, tried = (yield from other_noise(hunt, worst)) if broken and result.simulated else (0, 0)
    figures = result.measurements
    return RequirementFound(
        passed=False if broken else True if whole else None,
        kind=kind(result, limits),
        limit_cycle=figures.limit_cycle,
        ratio=figures.limit_cycle_ratio,
        frequency=figures.limit_cycle_frequency,
        seeds_failed=failed,
        seeds_tried=tried,
        command=hunt.command(worst),
        status=result.status,
    )


def other_noise(hunt: Hunt, member: Member) -> Asking[tuple[int, int]]:
    """With how many of the other realizations of the noise a member fails, and how many were tried."""
    results = yield from hunt.history.results(hunt.afford([replace(member, seed=seed) for seed in SEEDS]))
    return sum(fails(result, hunt.protocol.stability) for result in results), sum(result.judged for result in results)


def effects(hunt: Hunt) -> Asking[tuple[Effect, ...]]:
    """How the largest values of the heaviest criteria change with each parameter at its other end."""
    found = []
    hunt.allot(CONFIRMED)
    for target, own in worst_members(hunt).items():
        signs = dict(own.deviations)
        others = {
            name: replace(own, deviations=tuple({**signs, name: -sign or 1.0}.items())) for name, sign in signs.items()
        }
        tried = hunt.afford([own, *others.values()])
        results = dict(zip(tried, (yield from hunt.history.results(tried)), strict=True))
        for name, member in others.items():
            if own in results and member in results:
                found.append(
                    Effect(name, signs[name], target.name, _change(results[own], results[member], target.name))
                )
    yield from hunt.note("effects")
    return tuple(found)


def _change(before: CaseResult, after: CaseResult, name: str) -> float | None:
    values = [getattr(result.measurements, name) for result in (before, after)]
    return None if None in values or not all(map(math.isfinite, values)) else values[1] - values[0]
