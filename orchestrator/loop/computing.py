"""The computing time of a controller as results state it; :mod:`.probe` measures it."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..codec import Natural, NonNegative, Struct

FIRST_STEPS, MAX_STEPS = 20, 2000
"""Steps that tell how many are worth their time, and the most that are timed."""

TIMED_DURATION = 0.1
"""Time [s] that the timed steps may take together; a few are timed in any case."""

NANOSECOND = 1e-9


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


def computing_time(times: Callable[[int], np.ndarray]) -> ComputingTime:
    """From ``times(steps)``: the wall times [s] of so many steps, or of as many as there are."""
    few = times(FIRST_STEPS)
    # A controller of 50 ms a step would else take 100 s to be timed. The median of a coarse clock may be 0.
    many = int(min(MAX_STEPS, TIMED_DURATION / max(float(np.median(few)), NANOSECOND)))
    wall_times = few if many <= FIRST_STEPS else times(many)
    median, most, largest = np.percentile(wall_times, (50, 99, 100)).tolist()
    return ComputingTime(len(wall_times), median, most, largest)
