"""V found: the protocol's list, then V by pose, each start in legs."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import replace

from . import by_pose, moves
from .arms import known
from .by_pose import Climb
from .history import Asking
from .hunt import Hunt, Share, card
from .member import Member, Pair, names, spelled
from .moves import combined, single_effects
from .target import Target, severity

SEARCHED, SEARCHED_ALONE = 0.4, 0.8
"""Share of what the list leaves of the budget that V by pose takes, and of the whole one where there is no list."""

LEGS = (0.25, 0.5, 1.0)
"""Shares of that after which the best members are repeated over the whole case, and V found is written down."""

STARTERS = 4
"""Members of the list at each configuration that the search for a criterion begins with."""

KNOWN = 0.1
"""Share of a start's budget that the arms known of other controllers may take, for each criterion."""


def search(hunt: Hunt, seed: int) -> Asking[None]:
    """Simulate the list, then search for V by pose from its worst cases; without a list, from the nominal system."""
    yield from hunt.history.results(hunt.listed)
    goes_on = yield from hunt.note("list" if hunt.listed else "nominal system")
    criteria = [target for target in hunt.targets if target.criterion]
    if not goes_on or not criteria:
        return
    first, share = hunt.history.spent, SEARCHED if hunt.listed else SEARCHED_ALONE
    whole = share * (hunt.budget - first)
    specs = hunt.rules.criteria
    weights = {target: specs[target.criterion].weight / specs[target.criterion].target for target in criteria}
    for start in range(hunt.restarts):
        begin, end = (first + whole * number / hunt.restarts for number in (start, start + 1))
        climb = Climb(hunt.history, criteria, hunt.poses, weights, seed, start, end)
        yield from _begin(hunt, climb)
        confirmed = list[Member]()
        name = f"V by pose, start {start + 1}" if hunt.restarts > 1 else "V by pose"
        for leg, part in enumerate(LEGS):
            limit = begin + part * (end - begin)
            yield from by_pose.rise(climb, limit - _price_of_confirming(hunt, climb))
            rest = Share(hunt, limit - hunt.history.spent)
            best = rest.afford(by_pose.best(climb))
            yield from hunt.history.results(best)
            quiet = rest.afford(_undisturbed(hunt, best))
            yield from hunt.history.results(quiet)
            confirmed += [*best, *quiet]
            hunt.cut = False  # what is not confirmed in this leg is in the next
            if not (yield from hunt.note(f"{name}, {leg + 1} of {len(LEGS)}")):
                return
            if leg + 1 < len(LEGS):
                yield from by_pose.learn(climb, best)
        hunt.starts.append(card(hunt, [*hunt.listed, *confirmed]).cost)


def _begin(hunt: Hunt, climb: Climb) -> Asking[None]:
    """Try what each criterion's search begins with: the worst of the list at each configuration, and the arms known of
    other controllers; or, without a list, each parameter alone at one of them, and all at the worse ends at each."""
    for target in climb.targets:
        if not hunt.listed:
            yield from _explore(climb, target)
            continue
        taken = Counter[Pair]()
        starters = []
        for member in hunt.history.ranked(target):
            if member in set(hunt.listed):
                taken[member.q_a] += 1
                if taken[member.q_a] <= STARTERS:
                    starters.append(spelled(member, hunt.protocol, target.test))
        # A controller that reacts to large errors may leave the arm ringing after a weak force.
        if target.criterion == "B6":
            starters += _weakly_pushed(hunt, target)
        yield from by_pose.begin(climb, target, starters)
        if hunt.known:
            arms = [arm for arm in known(target, hunt.protocol) if arm.q_a in hunt.poses]
            yield from by_pose.begin(climb, target, arms, KNOWN)


def _weakly_pushed(hunt: Hunt, target: Target) -> list[Member]:
    """Each arm of the list in ``target``'s test at each configuration, under forces that load the joints little."""
    arms = {(member.q_a, member.system): spelled(member, hunt.protocol, target.test) for member in hunt.listed}
    return [pushed for arm in arms.values() for pushed in moves.weak_forces(arm)]


def _explore(climb: Climb, target: Target) -> Asking[None]:
    protocol = climb.protocol
    nominal = Member(climb.poses[0], target.test, tuple((name, 0.0) for name in names(protocol)))
    start = spelled(nominal, protocol, target.test)
    alone = single_effects(start, protocol)
    results = yield from by_pose.begin(climb, target, [start, *alone.values()])
    if len(results) <= len(alone):  # the budget does not last for it
        return
    severities = {
        key: severity(target, result, protocol.stability) for key, result in zip(alone, results[1:], strict=True)
    }
    worse = {symbol: max((-1.0, 1.0), key=lambda sign: severities[symbol, sign]) for symbol in protocol.uncertainty}
    yield from by_pose.begin(climb, target, [combined(start, worse, protocol)])


def _price_of_confirming(hunt: Hunt, climb: Climb) -> float:
    """Whole cases to be kept back for the best members of the peaks."""
    return float((len(hunt.poses) + 1) * len(climb.targets) * by_pose.CONFIRMED) * 1.1


def _undisturbed(hunt: Hunt, members: Sequence[Member]) -> list[Member]:
    """The arms of ``members`` in the tests without a disturbance, where the other criteria are measured."""
    tests = [test for test in hunt.protocol.tests if test.criteria and not test.disturbed]
    quiet = (replace(member, test=test.name, phi_F=None, sweep=None, t_3=None) for test in tests for member in members)
    return list(dict.fromkeys(quiet))
