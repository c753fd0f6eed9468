"""What is measured of a controller beside its cases: its timing, its computing time, whether it carries state over.

Exporters differ in when a sampled controller takes its samples:

1. at the start of each step: outputs after doStep k belong to the inputs set before it;
2. once during initialization, then at the end of each step;
3. at the start of the first step and at the end of every step, so twice in the first.

All three answer an input within the step it was set for, so none adds to the loop delay; they differ in one extra
sample of the first error. A probe compares responses to the same step in the input, begun at different moments, each of
an instance of its own. :mod:`.probe` does this, and measures the computing time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from types import MappingProxyType

import numpy as np

from ..codec import Natural, NonNegative, Struct

SAMPLES = 12
"""Length of a response."""

LATE = 4
"""The sample at which the late step begins; latencies up to SAMPLES - LATE are seen."""

ERROR = 1e-3
"""Height of the step in the position error [rad]: far above rounding, far below saturation."""


class Convention(str, Enum):
    """When a controller takes its samples."""

    STEP_START = "samples at the start of each step"
    INITIALIZATION = "samples once during initialization, then at the end of each step"
    TWICE = "samples twice in the first step"
    UNKNOWN = "is unknown: the response to a step depends on when it begins"
    RANDOM = "gives other torques each time"
    SILENT = "does not respond to a change of the measured angles"


@dataclass(frozen=True)
class ControllerTiming:
    """``latency`` in samples from a change of the input to that of the output, None if there is none.

    ``first_torque`` [N.m] is the output of the first step at rest.
    """

    latency: int | None
    convention: Convention
    first_torque: tuple[float, float]


def step_errors(begin: int) -> np.ndarray:
    """Position errors [rad], shape (SAMPLES, 2), that rise by ERROR at sample ``begin``."""
    errors = np.zeros((SAMPLES, 2))
    errors[begin:] = ERROR
    return errors


EXPERIMENTS = ((SAMPLES, 0.0), (LATE, 0.0), (0, 0.0), (0, ERROR))
"""The responses that :func:`timing` compares: the sample at which the errors rise, and the error [rad] during
initialization."""

STEP = 1
"""The place among them of a step that begins late."""


def timing(responses: Sequence[np.ndarray]) -> ControllerTiming:
    """The timing of a controller from its torques [N.m] in the EXPERIMENTS, each of shape (SAMPLES, 2)."""
    rest, late, early, from_initialization = responses
    torque = (float(rest[0, 0]), float(rest[0, 1]))
    # NaN differs from itself, and a controller that gives it twice has not responded.
    different = (late != rest) & ~(np.isnan(late) & np.isnan(rest))
    answered = np.flatnonzero(np.any(different, axis=1))
    if answered.size == 0:
        return ControllerTiming(None, Convention.SILENT, torque)
    latency = int(answered[0]) - LATE
    # Before the step begins, both instances were given the same: what differs there is chance.
    if latency < 0:
        return ControllerTiming(None, Convention.RANDOM, torque)
    deviation, first = late[LATE:] - rest[LATE:], early - rest
    return ControllerTiming(latency, _convention(deviation, first, from_initialization - rest), torque)


def _convention(late: np.ndarray, early: np.ndarray, initial: np.ndarray) -> Convention:
    """From the responses to a step at a late sample, at the first one, and during initialization as well."""
    length = late.shape[0]

    def same(response: np.ndarray, ahead: int) -> bool:
        """Whether ``response`` is the late one, ``ahead`` samples further on."""
        return np.allclose(response[: length - ahead], late[ahead:], rtol=1e-6, atol=1e-9 * np.max(np.abs(late)))

    if same(early, 0):
        if same(initial, 0):
            return Convention.STEP_START
        return Convention.INITIALIZATION if same(initial, 1) else Convention.UNKNOWN
    return Convention.TWICE if same(early, 1) else Convention.UNKNOWN


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


class CarryOver(str, Enum):
    """What repeating a simulation in a fresh process has shown of two FMUs; see :func:`carry_over`."""

    NOT_TESTED = "not tested"
    NONE = "none"
    DECLARED = "declared"
    FOUND = "found"
    RANDOM = "not deterministic"

    @property
    def separates(self) -> bool:
        """Whether simulations are right only in processes of their own."""
        return self in (CarryOver.FOUND, CarryOver.RANDOM)


WORDS: Mapping[CarryOver, str] = MappingProxyType(
    {
        CarryOver.DECLARED: "the FMU declares that a process can instantiate it only once",
        CarryOver.FOUND: "state passes from one simulation to the next in the same process",
        CarryOver.RANDOM: "the same simulation gives other numbers each time, also in a fresh process",
    }
)
"""What has been found, for those that need a process for each simulation."""


def carry_over(after: bytes, fresh: bytes, again: Callable[[], bytes | None]) -> CarryOver:
    """From the numbers of one simulation that ran ``after`` another one, ``fresh`` in a new process, and, if these two
    differ, ``again`` in a new process; None if it had no numbers there."""
    if after == fresh:
        return CarryOver.NONE
    # Two fresh processes that differ show a controller that is not deterministic,
    # whatever ran before; only a third simulation tells the two apart.
    return CarryOver.FOUND if again() == fresh else CarryOver.RANDOM
