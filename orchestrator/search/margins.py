"""How far a controller is from failing: margins of gain and delay."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from ..benchmark.protocol import Protocol
from .answers import SEEDS, other_noise
from .descent import Levels, contenders, descend
from .findings import Margin
from .history import Asking
from .hunt import Hunt
from .member import Member
from .radius import COST, STABILITY, whole
from .target import Target

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
    by_name = {}
    after = STABILITY + COST if whole(hunt) else 0
    levels = {
        axis: [entry for entry in _levels(hunt.protocol, axis) if entry.target in hunt.targets] for axis in (1, 2)
    }
    left = sum(SHARES[entry.kind] for entries in levels.values() for entry in entries)
    for axis, entries in levels.items():
        for entry in entries:
            hunt.allot(SHARES[entry.kind] / (left + after))
            left -= SHARES[entry.kind]
            if (margin := (yield from _margin(hunt, entry, seed))) is not None:
                by_name[entry.name] = margin
        hunt.cut = any(entry.name not in by_name for entry in entries)  # a longer search may always find less
        yield from hunt.note(f"margins of axis {axis}")
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


def _margin(hunt: Hunt, entry: Levels, seed: int) -> Asking[Margin | None]:
    """The margin, within the stage's share; None if that does not last for a single member."""
    limit, members = float(entry.scale[-1]), contenders(hunt, entry.target)
    # A margin that is found is tried with other noise: the descent may not spend what that takes.
    share, hunt.limit = hunt.limit, hunt.limit - len(SEEDS)
    if not members or not hunt.afford([entry.at(members[0], entry.scale[-1])]):
        return None
    smallest = yield from descend(hunt, entry, members, seed)
    hunt.limit = share
    if smallest is None:
        return Margin(None, limit)
    step, member = smallest
    failed, tried = yield from other_noise(hunt, member)
    return Margin(float(entry.scale[step]), limit, failed, tried, hunt.command(member))
