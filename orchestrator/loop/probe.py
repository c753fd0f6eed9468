"""What a controller does around a communication step: its latency, and which timing convention it follows.

Exporters differ in when a sampled controller takes its samples:

1. at the start of each step: outputs after doStep k belong to the inputs set before it;
2. once during initialization, then at the end of each step;
3. at the start of the first step and at the end of every step, so twice in the first.

All three answer an input within the step it was set for, so none adds to the loop delay; they differ in one extra
sample of the first error. The probe compares responses to the same step in the input, begun at different moments.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from fractions import Fraction

import numpy as np

from ..fmi.port import WARNING, exchange
from ..fmi.slaves import Slave
from .controller import Remote, Steady, prepared
from .master import exchange_failure
from .setup import Setup

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
    SILENT = "does not respond to a change of the measured angles"


@dataclass(frozen=True)
class Timing:
    """``latency`` in samples from a change of the input to that of the output, None if there is none.

    ``first_torque`` [N.m] is the output of the first step at rest.
    """

    latency: int | None
    convention: Convention
    first_torque: tuple[float, float]


def probe(slave: Slave | Remote, setup: Setup, steady: Steady, sample_time: Fraction) -> Timing:
    """Measure the timing of a controller at rest in the steady state ``steady``."""

    def respond(begin: int, initially: bool = False) -> np.ndarray:
        return response(slave, setup, steady, sample_time, begin, initially)

    rest, late, early, from_initialization = respond(SAMPLES), respond(LATE), respond(0), respond(0, True)
    torque = (float(rest[0, 0]), float(rest[0, 1]))
    different = (late != rest) & ~(np.isnan(late) & np.isnan(rest))
    answered = np.flatnonzero(np.any(different, axis=1))
    if answered.size == 0:
        return Timing(None, Convention.SILENT, torque)
    latency = int(answered[0]) - LATE
    deviation, first = late[LATE:] - rest[LATE:], early - rest
    return Timing(latency, _convention(deviation, first, from_initialization - rest), torque)


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


def response(
    slave: Slave | Remote,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    begin: int,
    initially: bool = False,
) -> np.ndarray:
    """Torques [N.m], shape (SAMPLES, 2), while the measured angles fall by ERROR at sample ``begin``.

    With ``initially`` they are there already during initialization. Raises
    :class:`~orchestrator.errors.FmuError` if a call fails.
    """
    errors = np.zeros((SAMPLES, 2))
    errors[begin:] = ERROR
    return answers(slave, setup, steady, sample_time, errors, ERROR if initially else 0.0)


def answers(
    slave: Slave | Remote,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    errors: np.ndarray,
    initial_error: float = 0.0,
) -> np.ndarray:
    """Torques [N.m] of a controller at rest that measures ``q_m_ref - errors``; shapes (N, 2), errors in rad.

    During initialization it measures ``q_m_ref - initial_error``. Raises :class:`~orchestrator.errors.FmuError` if a
    call fails.
    """
    q_m_ref = np.array(steady.q_m_ref)
    first = (steady.q_m_ref[0] - initial_error, steady.q_m_ref[1] - initial_error)
    step = float(sample_time)
    torques = np.empty_like(errors)
    with prepared(slave, setup, steady, sample_time, len(errors) * step, first) as port:
        for k, measured in enumerate(q_m_ref - errors):
            port.input_values[:] = port.scale * (measured - port.offset)
            call, status = exchange(port, port.inputs.size, float(k * sample_time), step, True)
            if status > WARNING:
                raise exchange_failure(slave, call, status)
            torques[k] = port.output_scale * port.output_values
    return torques
