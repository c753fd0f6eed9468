"""What the motion at the end of a simulation will come to, as far as its amplitudes in the last windows say.

All functions look at one coordinate: ``amplitudes`` [m] are half its peak-to-peak in successive windows, ``left`` is
the number of windows until the latest time that a case is simulated to. Nothing but +, -, *, / and comparisons: the
same answer on every platform.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence

from .protocol import Stability

LARGEST_RATIO = 1e6
"""Of a motion that was none a window before."""


def ratios(amplitudes: Sequence[float]) -> list[float]:
    """The ratio of each window's amplitude to that of the window before."""
    return [_ratio(now, before) for before, now in itertools.pairwise(amplitudes)]


def _ratio(amplitude: float, before: float) -> float:
    return amplitude / max(before, amplitude / LARGEST_RATIO) if amplitude > 0.0 else 0.0


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
