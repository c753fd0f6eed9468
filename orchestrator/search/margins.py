"""How far a controller is from failing: margins of gain and delay."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import replace
from fractions import Fraction
from typing import Any

from ..benchmark.protocol import Protocol
from .answers import SEEDS, other_noise
from .arms import known
from .descent import STEP, Levels, contenders, descend, failing
from .findings import Margin
from .history import Asking, side_by_side
from .hunt import Hunt, Share
from .member import UNCHANGED, Member, changes, within
from .radius import COST, STABILITY, whole
from .target import Target, fails, suspect

GAINS_UP = (*(round(0.05 * step, 2) for step in range(21, 200)), *(0.5 * step for step in range(20, 41)))
GAINS_DOWN = (
    *(round(0.01 * step, 2) for step in range(95, 9, -5)),
    *(round(0.01 * step, 2) for step in range(9, 4, -1)),
)
DELAYS = tuple(Fraction(step, 40000) for step in range(1, 401))
"""Steps of loop gain, up to 20 and down to 0.05, and of the delay [s], up to 10 ms."""

SHARES = {"gain": 2, "gain down": 1, "delay": 2}
"""Shares of what is left that a search for a margin takes; A1 and A2 ask for the first and the last."""


def margins(hunt: Hunt, seed: int) -> Asking[dict[str, Margin]]:
    """Gain up and down and delay of each axis, at which any member was found to fail."""
    every = ((entry, axis) for axis in (1, 2) for entry in _levels(hunt.protocol, axis))
    levels = [(entry, axis) for entry, axis in every if entry.target in hunt.targets]
    whole_of_it = sum(SHARES[entry.kind] for entry, _ in levels) + (STABILITY + COST if whole(hunt) else 0)
    found = yield from side_by_side(
        [_margin(hunt, entry, axis, seed, hunt.share(SHARES[entry.kind] / whole_of_it)) for entry, axis in levels]
    )
    hunt.cut = None in found  # a longer search may always find less
    yield from hunt.note("margins")
    return {entry.name: margin for (entry, _), margin in zip(levels, found, strict=True) if margin is not None}


def lowered(hunt: Hunt, margins: Mapping[str, Margin]) -> Asking[dict[str, Margin]]:
    """The margins, where a later stage has met a failure below them with that as their value."""
    by_name, share = dict(margins), hunt.share(1.0)
    for axis in (1, 2):
        for entry in _levels(hunt.protocol, axis):
            margin, least = margins.get(entry.name), _least_known(hunt, entry, axis)
            if margin is not None and least is not None:
                value, member = least
                if margin.value is None or _harm(entry, value) < _harm(entry, margin.value):
                    by_name[entry.name] = yield from _found(hunt, entry, axis, value, member, share)
    return by_name


def _levels(protocol: Protocol, axis: int) -> Iterator[Levels]:
    T_d = protocol.loop.delay
    up, late = (_test_of(protocol, axis, by_gain) for by_gain in (True, False))

    def gain(member: Member, value: float) -> Member:
        return replace(member, gain=(value, 1.0) if axis == 1 else (1.0, value))

    def delay(member: Member, value: Fraction) -> Member:
        return replace(member, delay=(T_d + value, T_d) if axis == 1 else (T_d, T_d + value))

    yield Levels(f"gain_{axis}", up, GAINS_UP, gain, "gain")
    yield Levels(f"gain_{axis}_down", up, GAINS_DOWN, gain, "gain down")
    yield Levels(f"delay_{axis}", late, DELAYS, delay, "delay")


def _test_of(protocol: Protocol, axis: int, by_gain: bool) -> Target:
    """The test of A1 or A2 of an axis; one without a name if there is none."""
    tests = (
        test.name for test in protocol.tests if test.axis == axis and not test.repeats and (test.gain != 1.0) == by_gain
    )
    name = next(tests, "")
    return Target(name, name)


def _margin(hunt: Hunt, entry: Levels, axis: int, seed: int, share: Share) -> Asking[Margin | None]:
    """The margin, within the ``share``; None if that does not last for a single member, and no failure is known."""
    limit, members = float(entry.scale[-1]), contenders(hunt, entry.target)
    # A margin that is found is tried with other noise: the descent may not spend what that takes.
    share.left -= len(SEEDS)
    affordable = bool(members and share.afford([entry.at(members[0], entry.scale[-1])]))
    smallest = None
    if affordable:
        arms = known(entry.target, hunt.protocol) if hunt.known else {}
        first = yield from _as_known(hunt, entry, arms, share)
        smallest = yield from descend(hunt, entry, [*members, *arms], seed, share, first)
    share.left += len(SEEDS)
    least = _least_known(hunt, entry, axis)
    if least is None:
        return Margin(None, limit) if affordable else None
    value, member = least
    if smallest is not None and entry.scale[smallest[0]] == value:
        member = smallest[1]
    return (yield from _found(hunt, entry, axis, value, member, share))


def _as_known(
    hunt: Hunt, entry: Levels, arms: Mapping[Member, float], share: Share
) -> Asking[tuple[int, Member] | None]:
    """The smallest step at which one of the ``arms`` fails with just the change with which it failed elsewhere."""
    # A cycle may end at a larger gain: of two arms known to fail at 5.3, the race, which begins at 20, met none.
    changed = [
        (step, entry.at(arm, Fraction(str(value)) if entry.kind == "delay" else value))
        for arm, value in arms.items()
        if (step := _step(entry, value)) < len(entry.scale)
    ]
    verdicts = yield from failing(hunt, [member for _, member in changed], share)
    failed = (one for one, verdict in zip(changed, verdicts, strict=True) if verdict)
    return min(failed, key=lambda one: one[0], default=None)


def _step(entry: Levels, value: Any) -> int:
    """The first step of the scale that harms as much as ``value``."""
    harms = (place for place, level in enumerate(entry.scale) if _harm(entry, level) >= _harm(entry, value))
    return next(harms, len(entry.scale))


def _found(hunt: Hunt, entry: Levels, axis: int, value: Any, member: Member, share: Share) -> Asking[Margin]:
    failed, tried = yield from other_noise(hunt, member, share)
    refined = _refined(hunt, entry, axis, value, member)
    return Margin(float(value), float(entry.scale[-1]), failed, tried, hunt.command(member), refined)


def _least_known(hunt: Hunt, entry: Levels, axis: int) -> tuple[Any, Member] | None:
    """The smallest change that any stage has met a failure at, which may be none at all, and the member that fails."""
    failures = (
        (value, member)
        for member, result in hunt.history.result_of.items()
        if within(member)
        and (value := _changed(hunt, entry, axis, member)) is not None
        and fails(result, hunt.protocol.stability)
    )
    return min(failures, key=lambda pair: _harm(entry, pair[0]), default=None)


def _refined(hunt: Hunt, entry: Levels, axis: int, value: Any, member: Member) -> bool:
    """Whether the arm that fails at ``value`` was tried with a change that is less by a step of the descent, and did
    not show a failure there."""
    step = _step(entry, value)
    if step == 0:
        return True
    arm, lowest = _arm(member), _harm(entry, entry.scale[max(step - 1 - int(STEP * step), 0)])
    return any(
        _arm(other) == arm
        and (less := _changed(hunt, entry, axis, other)) is not None
        and lowest <= _harm(entry, less) < _harm(entry, value)
        and not suspect(result, hunt.protocol.stability)
        for other, result in hunt.history.result_of.items()
    )


def _arm(member: Member) -> Member:
    """The member without what a margin varies, and whatever its noise."""
    return replace(member, gain=None, delay=None, short=None, seed=0)


def _changed(hunt: Hunt, entry: Levels, axis: int, member: Member) -> Any:
    """How far a member's loop is changed on the scale of a margin; None if it is changed in another way."""
    changed = changes(member, hunt.protocol)
    (gain, delay), other = changed[axis - 1], changed[2 - axis]
    if other != UNCHANGED:
        return None
    if entry.kind == "delay":
        return delay if gain == 1.0 and delay >= 0 else None
    return gain if delay == 0 and _harm(entry, gain) >= _harm(entry, 1.0) else None


def _harm(entry: Levels, value: Any) -> float:
    """A number that grows with the harm of a change."""
    return -float(value) if entry.kind == "gain down" else float(value)
