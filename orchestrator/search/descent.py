"""Margins by descent: the smallest change of one axis at which any member of the uncertainty fails.

A population is searched just below the smallest gain or delay that is known to fail, and kept when the level goes down.
Small steps matter: a cycle that begins all at once shows itself only near its level, and what is far below has no rank.
Members may lie inside their ranges, at any pose of the workspace, under a force from any direction, with either sweep
and any noise. What a short simulation shows to be near a failure is repeated over the whole case; where that fails, the
level goes down. A failure is not monotone in the level: what is found is the smallest level found to fail.
"""

from __future__ import annotations

import math
import zlib
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import chain
from typing import Any, TypeVar

import numpy as np

from ..benchmark.protocol import Protocol
from ..loop.random_streams import stable_stream
from . import moves
from .history import Asking
from .hunt import Hunt, Share
from .member import Member, spelled
from .short import short
from .target import Scores, Target, fails, scores_of, suspect

Scale = TypeVar("Scale")

BATCH = 8
"""Members of a race that are tried at once."""

CONTENDERS = 2
"""Members of each named system, and of those that were searched, that a descent begins with."""

CHILDREN, DRAWN, PARENTS, REPEATED = 12, 4, 10, 2
"""Children in a generation, members drawn from the whole box beside them, the best that children come from, and those
that are repeated over the whole case."""

STEP, PATIENCE = 0.06, 4
"""Share of the smallest level that fails by which the next one is lower, and generations without a rise after which
that is halved."""

RISE = 0.01
"""What the nearest to a failure has to rise by for its level to be kept."""

DISPROVED = 1.0
"""What a member that is near a failure in a short simulation, and does not fail in the whole case, is put back by."""

TURNED, INSIDE = 0.4, 0.7
"""Shares of the children with signs turned, and with parameters moved inside their ranges; the others keep theirs."""

MOVED, PUSHED, ANYWHERE, SWEPT, HEARD = 0.25, 0.25, 0.1, 0.1, 0.15
"""Shares of the children that get another pose, direction of the force (near or any), sweep, and noise."""


@dataclass(frozen=True)
class Levels:
    """What is changed step by step: a ``scale`` from the harmless to the harmful, and how a member is changed by a step
    of it, in the test of ``target``; ``kind`` says what that is."""

    name: str
    target: Target
    scale: Sequence[Any]
    at: Callable[[Member, Any], Member]
    kind: str = ""


def contenders(hunt: Hunt, target: Target) -> list[Member]:
    """The worst of each system for ``target``, the worst first: which system has the least margin, the test does not
    tell; the nominal system if nothing is known."""
    taken: Counter[str] = Counter()
    worst = []
    for member in hunt.history.ranked(target):
        taken[member.system] += 1
        if taken[member.system] <= CONTENDERS:
            worst.append(member)
    return worst or [Member(hunt.poses[0], target.test)]


def descend(
    hunt: Hunt,
    levels: Levels,
    members: Sequence[Member],
    seed: int,
    share: Share,
    known: tuple[int, Member] | None = None,
) -> Asking[tuple[int, Member] | None]:
    """The smallest step found to fail and the member that fails there, within the ``share``; None if none does.

    Begins with a race of the ``members`` below what is ``known`` to fail. Then the level goes down in small steps, with
    the population that was near a failure above it: a cycle that begins all at once announces itself by longer
    vibrations only near its level.
    """
    scale, at, protocol = levels.scale, levels.at, hunt.protocol
    limits, view = protocol.stability, short(protocol, levels.target, 0.0)
    stream = stable_stream((seed, zlib.crc32(levels.name.encode()), len(scale)))

    def fail(some: Sequence[Member]) -> Asking[list[bool]]:
        return (yield from failing(hunt, some, share))

    best = yield from race(members, scale, at, fail, known)
    parents = [_plain(spelled(member, protocol, levels.target.test)) for member in members]
    level, step, calm, scores = -1, STEP, 0, dict[Member, Scores]()
    while (high := len(scale) if best is None else best[0]) > 0:
        if calm == PATIENCE:
            # Calm is no end: at a step of 0 the search goes on just below what fails, as long as its share lasts.
            step, calm = (0.5 * step if step * high >= 1.0 else 0.0), 0
        lower = max(high - 1 - int(step * high), 0)
        if level != lower:  # how near the best so far are to a failure at another level is not known
            level, calm, scores = lower, 0, {}
        tried = [parent for parent in parents if parent not in scores] or [
            *(_child(parents, protocol, stream) for _ in range(CHILDREN)),
            *(_drawn(parents[0], protocol, stream) for _ in range(DRAWN)),
        ]
        shown = {member: replace(at(member, scale[level]), short=view) for member in tried}
        if not (afforded := share.afford(list(shown.values()))):
            return best
        results = dict(zip(afforded, (yield from hunt.history.results(afforded)), strict=True))
        fresh = {member: results[case] for member, case in shown.items() if case in results}
        before = _largest(scores)
        scores |= {member: scores_of(result, limits) for member, result in fresh.items()}
        rises = any(now > then + RISE for now, then in zip(_largest(scores), before, strict=True))
        calm = 0 if rises else calm + 1
        suspects = [member for member, result in fresh.items() if suspect(result, limits)]
        suspects = sorted(suspects, key=lambda member: -scores[member].unrest)[:REPEATED]
        verdicts = yield from fail([at(member, scale[level]) for member in suspects])
        for member, fails_there in zip(suspects, verdicts, strict=True):
            if fails_there:
                best = level, at(member, scale[level])
            else:
                scores[member] = Scores(*(score - DISPROVED for score in scores[member]))
        parents = _parents(scores)
    return best


def _largest(scores: Mapping[Member, Scores]) -> Scores:
    """The largest of each score."""
    return Scores(*map(max, zip(*scores.values(), strict=True))) if scores else Scores()


def _parents(scores: Mapping[Member, Scores]) -> list[Member]:
    """The best by each score in turn: neither kind of a failure crowds out the other."""
    # The vibration shows from far a cycle that begins all at once, the unrest one that grows from nothing.
    by_vibration = sorted(scores, key=lambda member: -scores[member].vibration)
    by_unrest = sorted(scores, key=lambda member: -scores[member].unrest)
    return list(dict.fromkeys(chain.from_iterable(zip(by_vibration, by_unrest, strict=True))))[:PARENTS]


def failing(hunt: Hunt, members: Sequence[Member], share: Share) -> Asking[list[bool]]:
    """Whether members are known to fail: one that the ``share`` does not last for is not."""
    tried = set(share.afford(members))
    yield from hunt.history.results([member for member in members if member in tried])
    return [member in tried and fails(hunt.history.result_of[member], hunt.protocol.stability) for member in members]


def race(
    members: Sequence[Member],
    scale: Sequence[Scale],
    at: Callable[[Member, Scale], Member],
    fail: Callable[[Sequence[Member]], Asking[list[bool]]],
    known: tuple[int, Member] | None = None,
) -> Asking[tuple[int, Member] | None]:
    """The first step of ``scale``, from the harmless to the harmful, at which one of ``members`` fails, and that member
    there; what is ``known`` to fail if none fails below it, or None if none fails at the last.

    The first member's step is found by bisection. Each other one is tried just below the smallest failing step so far,
    and only if it fails there, its own is found. That is exact where a member that fails at a step fails beyond it,
    too. ``at(member, step)`` changes a member, ``fail(members)`` asks which of them fail.
    """
    best = known
    for first in (0, *range(1, len(members), BATCH)):
        high = (len(scale) if best is None else best[0]) - 1
        low = -1
        some = members[first : first + BATCH if first else 1] if high >= 0 else []
        failing = yield from _failing_at(some, scale, high, at, fail)
        while failing and high - low > 1:
            middle = (low + high) // 2
            now = yield from _failing_at(failing, scale, middle, at, fail)
            if now:
                high, failing = middle, now
            else:
                low = middle
        if failing:
            best = high, at(failing[0], scale[high])
    return best


def _failing_at(
    members: Sequence[Member],
    scale: Sequence[Scale],
    step: int,
    at: Callable[[Member, Scale], Member],
    fail: Callable[[Sequence[Member]], Asking[list[bool]]],
) -> Asking[list[Member]]:
    verdicts = yield from fail([at(member, scale[step]) for member in members])
    return [member for member, failed in zip(members, verdicts, strict=True) if failed]


def _plain(member: Member) -> Member:
    return replace(member, gain=None, delay=None, short=None)


def _child(parents: Sequence[Member], protocol: Protocol, stream: np.random.RandomState) -> Member:
    child = parents[min(int(stream.exponential(1.5)), len(parents) - 1)]
    # Inside the ranges, too: a limit cycle needs friction that is neither too small nor too large.
    kind = moves.either(stream, (("turned", TURNED), ("inside", INSIDE), ("as it is", 1.0)))
    if kind != "as it is":
        child = moves.turned(child, stream) if kind == "turned" else moves.inside(child, stream)
    draws = stream.uniform(size=4)
    if draws[0] < MOVED:
        child = moves.moved(child, protocol, stream)
    if draws[1] < PUSHED:
        pushed = moves.with_any_force_direction if draws[1] < ANYWHERE else moves.with_other_force_direction
        child = pushed(child, stream)
    if draws[2] < SWEPT:
        child = moves.with_other_sweep(child, protocol)
    return moves.with_other_noise(child, stream) if draws[3] < HEARD else child


def _drawn(member: Member, protocol: Protocol, stream: np.random.RandomState) -> Member:
    """A member of which everything is drawn, half of the parameters at an end of their ranges."""
    ends = stream.uniform(size=len(member.deviations)) < 0.5
    values = stream.uniform(-1.0, 1.0, len(member.deviations))
    deviations = (
        (name, math.copysign(1.0, value) if end else round(float(value), 2))
        for end, value, (name, _) in zip(ends, values, member.deviations, strict=True)
    )
    workspace = protocol.workspace
    q_a = round(stream.uniform(*workspace.q_a1_deg), 1), round(stream.uniform(*workspace.q_a2_deg), 1)
    drawn = moves.with_any_force_direction(replace(member, q_a=q_a, deviations=tuple(deviations)), stream)
    return moves.with_other_noise(moves.with_other_sweep(drawn, protocol) if stream.uniform() < 0.5 else drawn, stream)
