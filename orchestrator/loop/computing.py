"""The computing time of a controller as results state it; :mod:`.stopwatch` measures it."""

from __future__ import annotations

from ..codec import Natural, NonNegative, Struct

MANY = 2000
"""The most steps that are timed."""


class ComputingTime(Struct):
    """Wall time [s] of one step of a controller, its inputs set and its outputs read: median, 99th percentile and the
    largest of ``steps``. The largest depends on the machine as much as on the controller. A median of 0 says that a
    step takes less than the clock of the machine resolves."""

    steps: Natural
    median: NonNegative
    percentile_99: NonNegative
    largest: NonNegative

    @property
    def text(self) -> str:
        """The three in words."""
        if self.median == 0.0:
            return "below the resolution of this machine's clock"
        micro = (1e6 * value for value in (self.median, self.percentile_99, self.largest))
        median, most, largest = (f"{value:.3g}" if value < 1e3 else f"{value:.0f}" for value in micro)
        return f"{median} µs median, {most} µs 99 %, {largest} µs largest"
