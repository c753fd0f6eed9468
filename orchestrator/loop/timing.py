"""What a controller does around a communication step: its latency, and which timing convention it follows.

Exporters differ in when a sampled controller takes its samples:

1. at the start of each step: outputs after doStep k belong to the inputs set before it;
2. once during initialization, then at the end of each step;
3. at the start of the first step and at the end of every step, so twice in the first.

All three answer an input within the step it was set for, so none adds to the loop delay; they differ in one extra
sample of the first error. A probe compares responses to the same step in the input, begun at different moments, each of
an instance of its own.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

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
