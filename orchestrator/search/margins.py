"""How far a controller is from failing: margins of gain and delay, and the factor on all tolerances."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from fractions import Fraction
from typing import Any, NamedTuple

from ..benchmark.protocol import Protocol
from .findings import Margin, Radius
from .history import Asking
from .hunt import SEEDS, Hunt, card, costs, other_noise, worst_at_each
from .member import Member, loose
from .race import race
from .target import Target, fails, targets

CONTENDERS = 5
"""Members of each named system, and of those that were searched, that race for a margin."""

STABILITY, COST = 1, 3
"""Shares of the two radii, beside one of each margin."""

GAINS_UP = tuple(round(1.02**power, 4) for power in range(1, 152))
GAINS_DOWN = tuple(round(1.05**-power, 4) for power in range(1, 60))
DELAYS = tuple(Fraction(step, 16000) for step in range(1, 161))
SCALES = tuple(step / 20 for step in range(1, 25))
"""Steps of loop gain, delay [s] and factor on the half-widths: up to 20 and down to 0.056, 10 ms, and 1.2."""


class Spent(Exception):
    """The share of a stage does not last for what it needs."""


class Race(NamedTuple):
    """A margin to be found: its name, the test of its axis, the scale, and how a member is changed by a step of it."""

    name: str
    target: Target
    scale: Sequence[Any]
    at: Callable[[Member, Any], Member]


def margins(hunt: Hunt) -> Asking[dict[str, Margin]]:
    """Gain up and down and delay of each axis, worst over the members nearest to failing in that axis' tests."""
    found = {}
    after = STABILITY + COST if _whole(hunt) else 0
    races = {axis: [race for race in _races(hunt.protocol, axis) if race.target in hunt.wanted] for axis in (1, 2)}
    left = sum(map(len, races.values()))
    for axis, entries in races.items():
        for entry in entries:
            hunt.allot(1 / (left + after))
            left -= 1
            if (margin := (yield from _margin(hunt, entry))) is not None:
                found[entry.name] = margin
        yield from hunt.note(f"margins of axis {axis}")
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


def _margin(hunt: Hunt, entry: Race) -> Asking[Margin | None]:
    """The margin, within the stage's share; None if that does not last for a single member."""
    limit, members = float(entry.scale[-1]), _contenders(hunt, entry.target)
    share, hunt.limit = hunt.limit, hunt.limit - len(SEEDS)
    if members and not hunt.afford([entry.at(members[0], entry.scale[-1])]):
        return None
    found = yield from race(members, entry.scale, entry.at, lambda tried: _fail(hunt, tried))
    hunt.limit = share
    if found is None:
        return Margin(None, limit)
    step, member = found
    failed, tried = yield from other_noise(hunt, member)
    return Margin(float(entry.scale[step]), limit, failed, tried, hunt.command(member))


def _contenders(hunt: Hunt, target: Target) -> list[Member]:
    """The worst of each system for ``target``, the worst first: which system has the least margin, the test does not
    tell."""
    taken: Counter[str] = Counter()
    found = []
    for member in hunt.history.ranked(target):
        taken[member.system] += 1
        if taken[member.system] <= CONTENDERS:
            found.append(member)
    return found


def _fail(hunt: Hunt, members: Sequence[Member]) -> Asking[list[bool]]:
    """Whether members are known to fail: one that the stage's share does not last for is not."""
    tried = set(hunt.afford(members))
    yield from hunt.history.results([member for member in members if member in tried])
    return [member in tried and fails(hunt.history.found[member], hunt.protocol.stability) for member in members]


def _whole(hunt: Hunt) -> bool:
    """Whether everything is searched for, from a list: then there is a radius."""
    return bool(hunt.listed) and len(hunt.wanted) == len(targets(hunt.protocol))


def radius(hunt: Hunt) -> Asking[Radius | None]:
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
    broken = any((yield from _fail(hunt, members)))  # then the radius is below 1, whatever happens beyond
    scale = [factor for factor in SCALES if factor <= 1.0] if broken else SCALES
    lasts = not members or bool(hunt.afford([scaled(members[0], scale[-1])]))
    found = yield from race(members, scale, scaled, lambda tried: _fail(hunt, tried))
    yield from hunt.note("radius of stability")
    hunt.allot(1.0)
    try:
        cost = yield from _radius_of_cost(hunt, scaled)
    except Spent:
        lasts = False
    yield from hunt.note("radius of V")
    return Radius(cost, None if found is None else SCALES[found[0]], SCALES[-1]) if lasts else None


def _radius_of_cost(hunt: Hunt, scaled: Callable[[Member, float], Member]) -> Asking[float | None]:
    """By bisection: at 1 V of all that was found, else with the worst members of each configuration.

    Raises :class:`Spent` if the stage's share does not even last for the first steps.
    """
    worst = worst_at_each(hunt)
    quiet = [member for member in hunt.listed if not hunt.protocol.test(member.test).disturbed]
    steps = (0.0, *SCALES)

    def too_much(step: int) -> Asking[bool]:
        if step == one:
            cost, _ = costs(hunt)
        else:
            members = [scaled(member, steps[step]) for member in worst]
            if len(hunt.afford(members)) < len(members):
                raise Spent
            yield from hunt.history.results(members)
            cost = card(hunt, [*members, *quiet]).cost
        return cost is None or cost > hunt.rules.cost.target

    low, one, high = -1, steps.index(1.0), len(steps) - 1
    if not worst:
        return None
    if (yield from too_much(one)):
        high = one
    elif (yield from too_much(high)):
        low = one
    else:
        return None
    with suppress(Spent):
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if (yield from too_much(middle)) else (middle, high)
    return steps[high]
