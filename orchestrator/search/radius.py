"""The factor on all tolerances at which V passes its target, and at which a requirement fails."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

from .answers import worst_at_each
from .descent import contenders, failing, race
from .findings import Radius
from .history import Asking
from .hunt import Hunt, card, possible
from .member import Member, Pair, loose
from .short import short
from .target import Target, fails, severity, targets

STABILITY, COST = 1, 1
"""Shares of the two radii of what is left, beside one of each margin."""

SCALES = tuple(step / 20 for step in range(1, 25))
"""Steps of the factor on the half-widths, up to 1.2."""

SETTLING = 10.0
"""Time after the force [s] that a settling time is waited for."""


class Spent(Exception):
    """The share of a stage does not last for what it needs."""


def whole(hunt: Hunt) -> bool:
    """Whether everything is searched for, from a list: then there is a radius."""
    return bool(hunt.listed) and len(hunt.targets) == len(targets(hunt.protocol))


def radius(hunt: Hunt) -> Asking[Radius | None]:
    """The factors on all half-widths at which V passes its target and at which a requirement fails; None for a search
    for less than that, or without a list, or if the budget does not last for it."""
    if not whole(hunt):
        return None

    def wider(member: Member, factor: float) -> Member:
        return scaled(loose(member, hunt.protocol), factor)

    share = hunt.share(STABILITY / (STABILITY + COST))
    stability = [target for target in hunt.targets if not target.criterion]
    members = [member for target in stability for member in contenders(hunt, target)]
    broken = any((yield from failing(hunt, members, share)))  # then the radius is at most 1, whatever happens beyond
    scale = [factor for factor in SCALES if factor <= 1.0] if broken else SCALES
    lasts = not members or bool(share.afford([wider(members[0], scale[-1])]))
    smallest = yield from race(members, scale, wider, lambda tried: failing(hunt, tried, share))
    stability_refined = not hunt.cut
    yield from hunt.note("radius of stability")
    try:
        cost, cost_refined = yield from _radius_of_cost(hunt)
    except Spent:
        lasts = False
    yield from hunt.note("radius of V")
    # What fails with its own noise may hold with the one that members of other factors share.
    least = SCALES[smallest[0]] if smallest is not None else 1.0 if broken else None
    # A3 may fail in a loop that is not changed, of which no smaller factor was tried.
    results, limits = hunt.history.result_of, hunt.protocol.stability
    if (least is None or least > 1.0) and any(fails(results[member], limits) for member in possible(hunt)):
        least, stability_refined = 1.0, False
    return Radius(cost, least, SCALES[-1], cost_refined, stability_refined) if lasts else None


def scaled(member: Member, factor: float) -> Member:
    """The member with all its deviations by ``factor``."""
    return replace(member, deviations=tuple((name, factor * value) for name, value in member.deviations))


def _radius_of_cost(hunt: Hunt) -> Asking[tuple[float | None, bool]]:
    """The radius, and whether its share lasted for it.

    By bisection: at 1 V of all that was found; else V with the worst member of each criterion at each configuration, of
    short simulations, and with the other criteria as they are at 1.

    Raises :class:`Spent` if the stage's share does not even last for the first steps.
    """
    # At each configuration: with three members for all of them, the radius could be 1.1 where V found was 112.
    worst = {key: loose(member, hunt.protocol) for key, member in worst_at_each(hunt).items()}
    rules, share = hunt.rules, hunt.share(1.0)
    scorecard = card(hunt, possible(hunt))
    searched = {target.criterion for target, _ in worst}
    shares = [entry.share for name, entry in scorecard.criteria.items() if name not in searched]
    steps = (0.0, *SCALES)

    def too_much(step: int) -> Asking[bool]:
        if step == one:
            return scorecard.cost is None or scorecard.cost > rules.cost.target
        at = {
            key: scaled(replace(member, short=short(hunt.protocol, key[0], SETTLING)), steps[step])
            for key, member in worst.items()
        }
        if len(share.afford(list(at.values()))) < len(at):
            raise Spent
        results = yield from hunt.history.results(list(at.values()))
        values = {
            key: severity(key[0], result, hunt.protocol.stability) for key, result in zip(at, results, strict=True)
        }
        return _cost(hunt, values, shares) > rules.cost.target

    low, one, high = -1, steps.index(1.0), len(steps) - 1
    if not worst:
        return None, True
    if (yield from too_much(one)):
        high = one
    elif (yield from too_much(high)):
        low = one
    else:
        return None, True
    with suppress(Spent):
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (low, middle) if (yield from too_much(middle)) else (middle, high)
    return steps[high], high - low == 1


def _cost(hunt: Hunt, values: dict[tuple[Target, Pair], float], shares: Sequence[float | None]) -> float:
    """V of eq. (15) of the largest ``values`` by criterion and pose, and of the ``shares`` of other criteria."""
    total = sum(share or 0.0 for share in shares)
    for (target, _), value in values.items():
        spec = hunt.rules.criteria[target.criterion]
        total += spec.weight / spec.target * value / len(hunt.poses)
    return total
