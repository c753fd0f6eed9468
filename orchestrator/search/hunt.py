"""The stages of a search for the worst case, and what they find.

The budget is spent in this order: the protocol's list, a search from its worst cases, the worst members at all
configurations, the noise of what fails, the effect of each parameter, margins, radius. Each stage has a share of what
is left, and what it does not need goes to the next. Every decision looks at results alone, so the answer is the same
for any number of processes.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, NamedTuple

from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, Rules, Scorecard
from ..benchmark.scorecard import kind, score
from .archive import Archive
from .ascent import climb, explore, explored, single_effects
from .findings import (
    ConfigurationFound,
    CriterionFound,
    Effect,
    Found,
    Margin,
    Radius,
    RequirementFound,
    Step,
)
from .member import Member, loose, names
from .race import race
from .target import Target, fails, targets

SEEDS = range(1, 9)
"""Base seeds of the noise that a failure is tried with."""

CONTENDERS = 5
"""Members of each named system, and of those that were searched, that race for a margin."""

SEARCHED, SEARCHED_ALONE = 0.35, 0.7
"""Share of what the list leaves of the budget that the search takes, and of the whole one where there is no list."""

CONFIRMED = 0.25
"""Share of what is left that each of the next stages may take, which need some dozens."""

STABILITY, COST = 1, 3
"""Shares of the two radii, beside one of each margin."""

GAINS_UP = tuple(round(1.02**power, 4) for power in range(1, 152))
GAINS_DOWN = tuple(round(1.05**-power, 4) for power in range(1, 60))
DELAYS = tuple(Fraction(step, 16000) for step in range(1, 161))
SCALES = tuple(step / 20 for step in range(1, 25))
"""Steps of loop gain, delay [s] and factor on the half-widths: up to 20 and down to 0.056, 10 ms, and 1.2."""


class Spent(Exception):
    """The share of a stage does not last for what it needs."""


@dataclass
class Hunt:
    """A search: what it may ask, the members of the protocol's list, what is wanted, how a member's case is repeated,
    and whom to tell what stage it is in, how many simulations there were and the worst values; the answer is whether to
    go on. ``limit`` is the number of simulations at which the stage's share of the ``budget`` ends."""

    archive: Archive
    rules: Rules
    listed: Sequence[Member]
    wanted: Sequence[Target]
    command: Callable[[Member], str]
    told: Callable[[str, int, Mapping[str, float | None]], bool]
    budget: int
    path: list[Step] = field(default_factory=list)
    complete: bool = True
    limit: int = 0
    cut: bool = False
    cut_short: list[str] = field(default_factory=list)

    @property
    def protocol(self) -> Protocol:
        """The protocol whose uncertainty is searched."""
        return self.archive.protocol

    def allot(self, share: float) -> None:
        """Give the next stage a share of what is left of the budget."""
        spent = len(self.archive.found)
        self.limit = spent + int(share * (self.budget - spent))

    def afford(self, members: Sequence[Member]) -> list[Member]:
        """Those of ``members`` that the stage's share lasts for: all that are known, and the first of the others."""
        known = self.archive.found
        new = [member for member in dict.fromkeys(members) if member not in known]
        dropped = set(new[max(0, self.limit - len(known)) :])
        self.cut = self.cut or bool(dropped)
        return [member for member in members if member not in dropped]

    def note(self, stage: str) -> bool:
        """Write down what is known at the end of a stage; returns whether to go on."""
        if self.cut:
            self.cut_short.append(stage)
        self.cut = False
        worst = {target.name: self.archive.height(target) for target in self.wanted}
        self.path.append(Step(stage, len(self.archive.found), worst))
        self.complete = self.complete and self.told(stage, len(self.archive.found), worst)
        return self.complete


def least(protocol: Protocol, listed: Sequence[object], wanted: Sequence[Target]) -> int:
    """Simulations that a search begins with: the list, or each parameter alone."""
    return len(listed) or len({target.test for target in wanted}) * explored(protocol)


def search(hunt: Hunt, seed: int) -> None:
    """Simulate the list, then climb from its worst cases; without a list, from the nominal system."""
    archive, wanted = hunt.archive, hunt.wanted
    archive.results(hunt.listed)
    if not hunt.listed:
        start = Member((0.0, -90.0), "", tuple((name, 0.0) for name in names(hunt.protocol)))
        for target in {target.test: target for target in wanted}.values():
            explore(archive, target, replace(start, test=target.test))
    share = SEARCHED if hunt.listed else SEARCHED_ALONE
    if hunt.note("list" if hunt.listed else "each parameter alone"):
        climb(archive, wanted, int(share * (hunt.budget - len(archive.found))), seed, hunt.note)


def spread(hunt: Hunt) -> None:
    """The worst members of the heaviest criteria at every configuration: eq. (14) wants the maximum at each."""
    poses = dict.fromkeys(member.q_a for member in hunt.listed)
    hunt.allot(CONFIRMED)
    hunt.archive.results(hunt.afford([replace(member, q_a=q_a) for member in _worst(hunt).values() for q_a in poses]))
    hunt.note("all configurations")


def _worst(hunt: Hunt) -> dict[Target, Member]:
    """The criteria that are searched for, and the worst member of each."""
    found = ((target, hunt.archive.worst(target)) for target in hunt.wanted if target.criterion)
    return {target: loose(member, hunt.protocol) for target, member in found if member is not None}


def card(hunt: Hunt, members: Sequence[Member]) -> Scorecard:
    """The scorecard of those of ``members`` that stand at a configuration of the protocol."""
    results = (hunt.archive.found[member] for member in members)
    return score(hunt.rules, [result for result in results if result.configuration.index >= 0])


def _possible(hunt: Hunt) -> list[Member]:
    return [member for member in hunt.archive.found if member.possible]


def criteria(hunt: Hunt) -> dict[str, CriterionFound]:
    """The criteria with the largest values found."""
    found, listed = card(hunt, _possible(hunt)), card(hunt, hunt.listed)
    entries = {}
    for name, spec in hunt.protocol.criteria.items():
        target = Target(name, "", name)
        worst = hunt.archive.worst(target)
        where = Found(None, "") if worst is None else Found(hunt.archive.height(target), hunt.command(worst))
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


def requirements(hunt: Hunt) -> dict[str, RequirementFound]:
    """The requirements, each with the worst case found, which is tried with other noise where it fails."""
    protocol = hunt.protocol
    found = {}
    hunt.allot(CONFIRMED)
    for name in ("A1", "A2", "A3"):
        tests = [test for test in protocol.tests if name in test.requirements and not test.repeats]
        members = [
            (value, member) for test in tests for value, member in hunt.archive.heights(Target(test.name, test.name))
        ]
        if members:
            _, worst = max(members, key=lambda pair: pair[0])
            found[name] = _judged(hunt, worst)
    hunt.note("other noise")
    return found


def _judged(hunt: Hunt, worst: Member) -> RequirementFound:
    limits = hunt.protocol.stability
    (result,) = hunt.archive.results([worst])
    passed = not fails(result, limits)
    failed, tried = (0, 0) if passed else _seeds(hunt, worst)
    figures = result.measurements
    return RequirementFound(
        passed=passed,
        kind=kind(result, limits),
        limit_cycle=figures.limit_cycle,
        ratio=figures.limit_cycle_ratio,
        frequency=figures.limit_cycle_frequency,
        seeds_failed=failed,
        seeds_tried=tried,
        command=hunt.command(worst),
    )


def _seeds(hunt: Hunt, member: Member) -> tuple[int, int]:
    """With how many of the other realizations of the noise a member fails, and how many were tried."""
    results = hunt.archive.results(hunt.afford([replace(member, seed=seed) for seed in SEEDS]))
    return sum(fails(result, hunt.protocol.stability) for result in results), len(results)


class Race(NamedTuple):
    """A margin to be found: its name, the test of its axis, the scale, and how a member is changed by a step of it."""

    name: str
    target: Target
    scale: Sequence[Any]
    at: Callable[[Member, Any], Member]


def margins(hunt: Hunt) -> dict[str, Margin]:
    """Gain up and down and delay of each axis, worst over the members nearest to failing in that axis' tests."""
    found = {}
    after = STABILITY + COST if _whole(hunt) else 0
    races = {axis: [race for race in _races(hunt.protocol, axis) if race.target in hunt.wanted] for axis in (1, 2)}
    left = sum(map(len, races.values()))
    for axis, entries in races.items():
        for entry in entries:
            hunt.allot(1 / (left + after))
            left -= 1
            if (margin := _margin(hunt, entry)) is not None:
                found[entry.name] = margin
        hunt.note(f"margins of axis {axis}")
    return found


def _races(protocol: Protocol, axis: int) -> Iterator[Race]:
    T_d = protocol.loop.delay
    up, late = (_test_of(protocol, axis, by_gain) for by_gain in (True, False))

    def gain(member: Member, value: float) -> Member:
        return replace(member, gain=(value, 1.0) if axis == 1 else (1.0, value))

    def delay(member: Member, value: Fraction) -> Member:
        return replace(member, delay=(T_d + value, T_d) if axis == 1 else (T_d, T_d + value))

    yield Race(f"gain_{axis}", up, GAINS_UP, gain)
    yield Race(f"gain_{axis}_down", up, GAINS_DOWN, gain)
    yield Race(f"delay_{axis}", late, DELAYS, delay)


def _test_of(protocol: Protocol, axis: int, by_gain: bool) -> Target:
    """The test of A1 or A2 of an axis; one without a name if there is none."""
    tests = (
        test.name for test in protocol.tests if test.axis == axis and not test.repeats and (test.gain != 1.0) == by_gain
    )
    name = next(tests, "")
    return Target(name, name)


def _margin(hunt: Hunt, entry: Race) -> Margin | None:
    """The margin, within the stage's share; None if that does not last for a single member."""
    limit, members = float(entry.scale[-1]), _contenders(hunt, entry.target)
    share, hunt.limit = hunt.limit, hunt.limit - len(SEEDS)
    if members and not hunt.afford([entry.at(members[0], entry.scale[-1])]):
        return None
    found = race(members, entry.scale, entry.at, lambda tried: _fail(hunt, tried))
    hunt.limit = share
    if found is None:
        return Margin(None, limit)
    step, member = found
    failed, tried = _seeds(hunt, member)
    return Margin(float(entry.scale[step]), limit, failed, tried, hunt.command(member))


def _contenders(hunt: Hunt, target: Target) -> list[Member]:
    """The worst of each system for ``target``, the worst first: which system has the least margin, the test does not
    tell."""
    taken: Counter[str] = Counter()
    found = []
    for member in hunt.archive.ranked(target):
        taken[member.system] += 1
        if taken[member.system] <= CONTENDERS:
            found.append(member)
    return found


def _fail(hunt: Hunt, members: Sequence[Member]) -> list[bool]:
    """Whether members are known to fail: one that the stage's share does not last for is not."""
    tried = set(hunt.afford(members))
    hunt.archive.results([member for member in members if member in tried])
    return [member in tried and fails(hunt.archive.found[member], hunt.protocol.stability) for member in members]


def _whole(hunt: Hunt) -> bool:
    """Whether everything is searched for, from a list: then there is a radius."""
    return bool(hunt.listed) and len(hunt.wanted) == len(targets(hunt.protocol))


def radius(hunt: Hunt) -> Radius | None:
    """The factors on all half-widths at which V passes its target and at which a requirement fails; None for a search
    for less than that, or without a list, or if the budget does not last for it."""
    if not _whole(hunt):
        return None

    def scaled(member: Member, factor: float) -> Member:
        own = loose(member, hunt.protocol)
        return replace(own, deviations=tuple((name, factor * value) for name, value in own.deviations))

    hunt.allot(STABILITY / (STABILITY + COST))
    stability = [target for target in hunt.wanted if not target.criterion]
    members = [member for target in stability for member in _contenders(hunt, target)[:CONTENDERS]]
    broken = any(_fail(hunt, members))  # then the radius is below 1, whatever happens beyond
    scale = [factor for factor in SCALES if factor <= 1.0] if broken else SCALES
    lasts = not members or bool(hunt.afford([scaled(members[0], scale[-1])]))
    found = race(members, scale, scaled, lambda tried: _fail(hunt, tried))
    hunt.note("radius of stability")
    hunt.allot(1.0)
    try:
        cost = _radius_of_cost(hunt, scaled)
    except Spent:
        lasts = False
    hunt.note("radius of V")
    return Radius(cost, None if found is None else SCALES[found[0]], SCALES[-1]) if lasts else None


def _radius_of_cost(hunt: Hunt, scaled: Callable[[Member, float], Member]) -> float | None:
    """By bisection, with the worst members of the heaviest criteria at all configurations.

    Raises :class:`Spent` if the stage's share does not even last for the first steps.
    """
    poses = dict.fromkeys(member.q_a for member in hunt.listed)
    worst = list(dict.fromkeys(_worst(hunt).values()))
    quiet = [member for member in hunt.listed if not hunt.protocol.test(member.test).disturbed]
    steps = (0.0, *SCALES)

    def too_much(step: int) -> bool:
        members = [scaled(replace(member, q_a=q_a), steps[step]) for member in worst for q_a in poses]
        if len(hunt.afford(members)) < len(members):
            raise Spent
        hunt.archive.results(members)
        cost = card(hunt, [*members, *quiet]).cost
        return cost is None or cost > hunt.rules.cost.target

    low, one, high = -1, steps.index(1.0), len(steps) - 1  # of 1, most is known
    if not worst:
        return None
    if too_much(one):
        high = one
    elif too_much(high):
        low = one
    else:
        return None
    with suppress(Spent):
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if too_much(middle) else (middle, high)
    return steps[high]


def effects(hunt: Hunt) -> tuple[Effect, ...]:
    """How the largest values of the heaviest criteria change with each parameter at its other end."""
    found = []
    hunt.allot(CONFIRMED)
    for target, own in _worst(hunt).items():
        signs = dict(own.deviations)
        others = {
            symbol: member
            for (symbol, sign), member in single_effects(own, hunt.protocol).items()
            if sign != signs[f"{symbol}[1]"] or sign != signs[f"{symbol}[2]"]
        }
        tried = hunt.afford([own, *others.values()])
        results = dict(zip(tried, hunt.archive.results(tried), strict=True))
        for symbol, member in others.items():
            if own in results and member in results:
                found.append(Effect(symbol, target.name, _change(results[own], results[member], target.name)))
    hunt.note("effects")
    return tuple(found)


def _change(before: CaseResult, after: CaseResult, name: str) -> float | None:
    values = [getattr(result.measurements, name) for result in (before, after)]
    return None if None in values or not all(map(math.isfinite, values)) else values[1] - values[0]
