"""Whether the end of a case leaves a doubt about its verdict, and the longer simulation that settles it.

The stop time that FMUs get is the latest possible end, in all simulations.

What the motion will come to, as far as its amplitudes in the last windows say, is asked of one direction at a time,
since a cycle may be across a larger motion that dies out: ``amplitudes`` [m] are half the extent of the TCP's path in
successive windows, ``left`` is the number of windows until the latest time that a case is simulated to. Nothing but +,
-, *, / and comparisons: the same answer on every platform.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction

from ..loop.scenario import Scenario
from .case import JudgedCase
from .protocol import JudgingTables, Stability

MAX_RATIO = 1e6
"""Of a motion that was none a window before."""


def ratios(amplitudes: Sequence[float]) -> list[float]:
    """The ratio of each window's amplitude to that of the window before."""
    return [_ratio(now, before) for before, now in itertools.pairwise(amplitudes)]


def _ratio(amplitude: float, before: float) -> float:
    # A motion that was none has no ratio; infinity is no number in JSON.
    return amplitude / max(before, amplitude / MAX_RATIO) if amplitude > 0.0 else 0.0


def at_rest(limits: Stability, amplitudes: Sequence[float], left: int) -> bool:
    """Whether the motion is gone or goes away for sure: where it is ``doubtful`` or more, it has fallen below the share
    ``dying`` of the window before; it approaches nothing of that size; and it does not grow to a limit cycle."""
    shares = ratios(amplitudes)
    falls = all(
        now < limits.doubtful or share < limits.dying for now, share in zip(amplitudes[1:], shares, strict=True)
    )
    return falls and _floor(amplitudes) < limits.doubtful and not _grows(limits, amplitudes, left)


def _floor(amplitudes: Sequence[float]) -> float:
    """What amplitudes that fall ever more slowly approach: Aitken's extrapolation of the last three; 0 of others."""
    if len(amplitudes) < 3:
        return 0.0
    first, second, last = amplitudes[-3:]
    step, before = second - last, first - second
    return last - step * step / (before - step) if 0.0 < step < before else 0.0


def _grows(limits: Stability, amplitudes: Sequence[float], left: int) -> bool:
    """Whether the motion has grown in each window, and is a limit cycle ``left`` windows later if it grows on by the
    smallest ratio of those seen."""
    growth = min(ratios(amplitudes), default=0.0)
    grown = amplitudes[-1]
    for _ in range(left if growth > 1.0 else 0):
        grown *= growth
    return growth > 1.0 and grown >= limits.limit_cycle


def lasts(limits: Stability, amplitudes: Sequence[float], left: int) -> bool:
    """Whether the motion is a limit cycle for sure: still one if, from now on, it fell by the largest change between
    two windows in each window that is left."""
    steps = [abs(now - before) for before, now in itertools.pairwise(amplitudes)]
    return amplitudes[-1] - left * max(steps, default=0.0) >= limits.limit_cycle


def falls(amplitudes: Sequence[float]) -> bool:
    """Whether each amplitude is smaller than the one before."""
    return all(now < before for before, now in itertools.pairwise(amplitudes))


def doubtful(
    protocol: JudgingTables, case: JudgedCase, curves: Sequence[Sequence[float]], rest_error: float | None
) -> bool:
    """Whether a case that was simulated to its own end has to be simulated further.

    ``curves`` are, by direction, the amplitudes [m] in the last windows. There is a doubt if there is a limit cycle for
    sure in no direction, and in one of them the motion does not come to rest for sure, or if the TCP creeps to where
    its ``rest_error`` [m] is none; and the longer simulation has not reached its end.
    """
    limits, left = protocol.stability, windows_left(protocol, case)
    if left <= 0 or not curves:
        return False
    if any(lasts(limits, amplitudes, left) for amplitudes in curves):
        return False
    # In a window, the TCP moves by twice the amplitude at most.
    creep = 2.0 * left * max(amplitudes[-1] for amplitudes in curves)
    creeps = rest_error is not None and 0.0 < rest_error - limits.rest_error <= creep
    return creeps or not all(at_rest(limits, amplitudes, left) for amplitudes in curves)


def windows_left(protocol: JudgingTables, case: JudgedCase) -> int:
    """Windows between the end of ``case`` and the latest one; none if it is not simulated further in any case."""
    limits, scenario, end = protocol.stability, case.scenario, case.end
    cut = scenario.duration < case.test.duration  # its user wants no more of it
    if cut or not case.test.requirements or scenario.disturbed_until > end:
        return 0
    return max(int((limits.longest - end) / limits.limit_cycle_window), 0)


def with_latest_end(protocol: JudgingTables, case: JudgedCase) -> Scenario:
    """The scenario of ``case`` with the latest end that it may be simulated to."""
    if windows_left(protocol, case) == 0:
        return case.scenario
    return replace(case.scenario, duration=Fraction(protocol.stability.longest))
