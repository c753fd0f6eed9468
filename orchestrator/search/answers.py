"""What a search has found, read off its history; and what that takes beside it: other noise, effects of parameters."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

from ..benchmark.results import CaseResult
from ..benchmark.scorecard import kind
from .descent import Levels, contenders, descend
from .findings import ConfigurationFound, CriterionSearched, Effect, Found, PeakFound, RequirementSearched
from .history import Asking
from .hunt import CONFIRMED, Hunt, Share, card, possible
from .member import Member, Pair, loose, spelled
from .short import short
from .target import NICHES, Target, fails, severity

SETTLING = 10.0
"""Time after the force [s] that a settling time is waited for where a parameter is changed."""

HEARD = 0.1
"""Share of what is left that the worst arms of a criterion that jumps may take with other noise."""

LEVEL = 0.05
"""Share of what is left that the search for a failure in the loop as it is takes."""

SEEDS = range(1, 9)
"""Base seeds of the noise that a failure is tried with."""

FEW_SEEDS = SEEDS[:3]
"""Those that the worst arms for B6 are tried with. Of RobustLQG, the smallest of eight values was at least 0.91 of the
one found at each of 25 configurations, and 0.9997 of it in the median."""


def worst_members(hunt: Hunt) -> dict[Target, Member]:
    """The criteria that are searched for, and the worst member of each."""
    worst = ((target, hunt.history.worst(target)) for target in hunt.targets if target.criterion)
    return {target: loose(member, hunt.protocol) for target, member in worst if member is not None}


def criteria(hunt: Hunt) -> dict[str, CriterionSearched]:
    """The criteria with the largest values found."""
    card_found, card_of_list = card(hunt, possible(hunt)), card(hunt, hunt.listed)
    searched = {target.criterion for target in hunt.targets}
    entries = {}
    for name, spec in hunt.protocol.criteria.items():
        target = Target(name, "", name)
        worst = hunt.history.worst(target)
        where = Found(None, "") if worst is None else Found(hunt.history.severity(target), hunt.command(worst))
        if worst is not None and name in searched:
            hunt.shown.setdefault(worst, []).append(name)
        entries[name] = CriterionSearched(
            card_found.criteria[name].value, card_of_list.criteria[name].value, spec.unit, where
        )
    return entries


def worst_at_each(hunt: Hunt) -> dict[tuple[Target, Pair], Member]:
    """The worst member of each criterion that is searched for at each configuration."""
    worst: dict[tuple[Target, Pair], tuple[float, Member]] = {}
    for target in hunt.targets:
        for value, member in hunt.history.severities(target) if target.criterion else ():
            at = target, member.q_a
            if member.q_a in hunt.poses and (at not in worst or value > worst[at][0]):
                worst[at] = value, member
    return {at: member for at, (_, member) in worst.items()}


def heard(hunt: Hunt) -> Asking[None]:
    """Repeat the worst arms at the configurations with other noise, of a criterion that jumps: whether B6 is short or
    long is up to a controller that takes a force for an event or not, and near its threshold the noise may decide."""
    worst = [member for (target, _), member in worst_at_each(hunt).items() if target.criterion in NICHES]
    if not worst:
        return
    # Seed by seed, so that a small budget tries each pose with some.
    others = [replace(member, seed=seed) for seed in FEW_SEEDS for member in worst]
    yield from hunt.history.results(hunt.share(HEARD).afford(others))
    yield from hunt.note("V with other noise")


def peaks(hunt: Hunt) -> tuple[PeakFound, ...]:
    """The worst member of each criterion that was searched for at each configuration, in the protocol's order."""
    worst = worst_at_each(hunt)
    return tuple(
        _peak(hunt, target, worst[target, q_a])
        for q_a in hunt.poses
        for target in hunt.targets
        if (target, q_a) in worst
    )


def _peak(hunt: Hunt, target: Target, member: Member) -> PeakFound:
    result = hunt.history.result_of[member]
    told, limits = spelled(member, hunt.protocol, member.test), hunt.protocol.stability
    value = severity(target, result, limits)
    others = (hunt.history.result_of.get(replace(member, seed=seed)) for seed in FEW_SEEDS if seed != member.seed)
    values = tuple(severity(target, other, limits) for other in others if other is not None)
    return PeakFound(
        configuration=result.configuration.index,
        criterion=target.criterion,
        value=value if math.isfinite(value) else None,
        deviations=dict(told.deviations),
        phi_F=told.phi_F or 0.0,
        sweep=told.sweep or (0.0, 0.0),
        command=hunt.command(member),
        seed=told.seed,
        other_noise=tuple(other if math.isfinite(other) else None for other in sorted(values)),
    )


def costs(hunt: Hunt) -> tuple[float | None, float | None]:
    """V of eq. (15) with all that was found, and of the list alone."""
    return card(hunt, possible(hunt)).cost, card(hunt, hunt.listed).cost


def configurations(hunt: Hunt) -> tuple[ConfigurationFound, ...]:
    """V_k of the list, and with all that was found."""
    listed = {entry.index: entry.cost for entry in card(hunt, hunt.listed).configurations}
    entries = card(hunt, possible(hunt)).configurations
    return tuple(
        ConfigurationFound(entry.index, entry.q_a1, entry.q_a2, listed[entry.index], entry.cost)
        for entry in entries
        if entry.index in listed
    )


def requirements(hunt: Hunt) -> Asking[dict[str, RequirementSearched]]:
    """The requirements, each with the worst case found; where it fails it is tried with other noise. What the search
    for a margin has found counts: A1 and A2 ask for all smaller changes of gain and delay, too."""
    answers, share = {}, hunt.share(CONFIRMED)
    for name in ("A1", "A2", "A3"):
        members = _judged_by(hunt, name)
        if members:
            answers[name] = yield from _answer(hunt, name, members, share)
    yield from hunt.note("other noise")
    return answers


def broken_since(hunt: Hunt, answers: Mapping[str, RequirementSearched]) -> Asking[dict[str, RequirementSearched]]:
    """The same, where a failure was met since with that as the worst case."""
    by_name, limits, share = dict(answers), hunt.protocol.stability, hunt.share(1.0)
    for name, answer in answers.items():
        members = _judged_by(hunt, name)
        if answer.passed is not False and any(fails(hunt.history.result_of[member], limits) for _, member in members):
            for roles in hunt.shown.values():
                roles[:] = [role for role in roles if not role.startswith(f"{name} ")]
            hunt.shown = {member: roles for member, roles in hunt.shown.items() if roles}
            by_name[name] = yield from _answer(hunt, name, members, share)
    return by_name


def _judged_by(hunt: Hunt, name: str) -> list[tuple[float, Member]]:
    """The members that a requirement is judged by, and how bad each is."""
    tests = [test for test in hunt.protocol.tests if name in test.requirements and not test.repeats]
    return [pair for test in tests for pair in hunt.history.severities(Target(test.name, test.name))]


def _answer(
    hunt: Hunt, name: str, members: Sequence[tuple[float, Member]], share: Share
) -> Asking[RequirementSearched]:
    """A requirement by the worst of its ``members``, which is to be shown."""
    result_of, limits = hunt.history.result_of, hunt.protocol.stability
    # A simulation that crashed has no severity, but fails all the same.
    _, worst = max(members, key=lambda pair: (fails(result_of[pair[1]], limits), pair[0]))
    answer = yield from _judged(hunt, worst, all(result_of[member].judged for _, member in members), share)
    test = hunt.protocol.test(worst.test)
    if result_of[worst].simulated:
        hunt.shown.setdefault(worst, []).append(f"{name} {test.name if name == 'A3' else test.axis}")
    return answer


def disturbed(hunt: Hunt, seed: int) -> Asking[None]:
    """Search for members that do not come to rest in the loop as it is."""
    test = next((target.test for target in hunt.targets if target.criterion), None)
    if test is not None and (members := contenders(hunt, Target(test, test))):
        as_it_is = Levels(test, Target(test, test), (None,), lambda member, _: member)
        yield from descend(hunt, as_it_is, members, seed, hunt.share(LEVEL))
    hunt.cut = False  # a longer search may always find one
    yield from hunt.note("rest")


def _judged(hunt: Hunt, worst: Member, whole: bool, share: Share) -> Asking[RequirementSearched]:
    """What is known of a requirement by its worst case, if the ``whole`` of its simulations says something."""
    limits = hunt.protocol.stability
    (result,) = yield from hunt.history.results([worst])
    broken = fails(result, limits)
    failed, tried = (yield from other_noise(hunt, worst, share)) if broken and result.simulated else (0, 0)
    figures = result.measurements
    return RequirementSearched(
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


def other_noise(hunt: Hunt, member: Member, share: Share) -> Asking[tuple[int, int]]:
    """With how many of the other realizations of the noise a member fails, and how many were tried: as many as the
    ``share`` lasts for."""
    # Whether a cycle begins may be up to the noise: RobustLQG had an arm that failed with one of three seeds.
    results = yield from hunt.history.results(share.afford([replace(member, seed=seed) for seed in SEEDS]))
    return sum(fails(result, hunt.protocol.stability) for result in results), sum(result.judged for result in results)


def effects(hunt: Hunt) -> Asking[tuple[Effect, ...]]:
    """How the largest values of the heaviest criteria change with each parameter at its other end, in short
    simulations."""
    entries, share = [], hunt.share(CONFIRMED)
    for target, worst in worst_members(hunt).items():
        as_found = replace(worst, short=short(hunt.protocol, target, SETTLING))
        signs = dict(as_found.deviations)
        others = {
            name: replace(as_found, deviations=tuple({**signs, name: -sign or 1.0}.items()))
            for name, sign in signs.items()
        }
        tried = share.afford([as_found, *others.values()])
        results = dict(zip(tried, (yield from hunt.history.results(tried)), strict=True))
        for name, member in others.items():
            if as_found in results and member in results:
                entries.append(
                    Effect(name, signs[name], target.name, _change(results[as_found], results[member], target.name))
                )
    yield from hunt.note("effects")
    return tuple(entries)


def _change(before: CaseResult, after: CaseResult, name: str) -> float | None:
    values = [getattr(result.measurements, name) for result in (before, after)]
    return None if None in values or not all(map(math.isfinite, values)) else values[1] - values[0]
