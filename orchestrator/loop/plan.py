"""Transport delays, turned into a plan for every sample interval: where the plant's step is split, which torque acts
in each part, where a delayed measurement is taken.

Times are exact fractions, so that a delay of 0.3 samples splits a step at 0.3 and a delay of a whole sample does not
split it at all. The plan is the same for every sample interval, unless the measurement has jitter; the loop applies it
by the sample's index.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from .scenario import Delays

MAX_TICKS_PER_SECOND = 10**14
"""Largest number of ticks per second: 64-bit integers then count to 92,000 s."""

CELLS = 2**16
"""Of the jitter: so many times are equally likely."""


class Plan(NamedTuple):
    """The parts of the sample intervals, for the compiled loop. Interval k has row r = k modulo the number of rows:
    one row serves all intervals, or each has its own.

    The time of part p in interval k is ``(k * interval + offset[r, p]) / denominator`` seconds: integers, never
    accumulated. In part p axis i is driven by the command of sample ``k - drive_lag[r, p, i]``. Axis i is measured at
    the end of part ``sample_part[r, i]``, and the controller at sample k is given the value taken for sample
    ``k - sensor_lag[i]``.
    """

    interval: int
    denominator: int
    offset: np.ndarray
    """int64, shape (rows, parts)."""
    step: np.ndarray
    """Length of each part [s], shape (rows, parts)."""
    drive_lag: np.ndarray
    """int64, shape (rows, parts, 2)."""
    sample_part: np.ndarray
    """int64, shape (rows, 2)."""
    sensor_lag: np.ndarray
    """int64, shape (2,)."""


def make_plan(
    sample_time: Fraction,
    drive: Delays,
    sensor: Delays,
    longest: Fraction | None = None,
    jitter: Fraction = Fraction(0),
    cells: np.ndarray | None = None,
) -> Plan:
    """The plan for a sample time and the transport delays per axis, all exact and in seconds.

    No part is longer than ``longest``; by default there is no such limit.

    A command of sample k reaches the motor at t_k + delay; a measurement for sample k is taken at t_k minus the
    fractional part of the sensor's delay and given to the controller so many whole samples later. With ``jitter`` the
    measurement for sample k is taken earlier than that by ``cells[k]`` of the :data:`CELLS` cells of this time, and
    one tick, so that it never falls on the beginning of a part; ``cells`` has shape (intervals + 1,).

    Raises :class:`InputError` if the times have no common grid that integers can count, or the measurement for a sample
    could be taken before the interval that ends at it.
    """
    # Fractions: in floats, divmod(0.00225, 0.00025) is (8, 0.00025), a whole sample more.
    whole_drive, arrival = zip(*(divmod(delay, sample_time) for delay in drive), strict=True)
    whole_sensor, early = zip(*(divmod(delay, sample_time) for delay in sensor), strict=True)
    if not 0 <= jitter <= sample_time - max(early):
        message = f"The jitter of {float(jitter):g} s is not from 0 to the sample time of {float(sample_time):g} s, "
        raise InputError(f"{message}less the part of a sample by which the measurement is delayed.", "bad-jitter")
    takes = [sample_time - part for part in early]
    # The plant's substeps are of the benchmark's step: a slow controller must not coarsen the integration.
    holds = math.ceil(sample_time / longest) if longest else 1
    regular = [number * sample_time / holds for number in range(holds)]
    fixed = sorted({*regular, *arrival, *(take for take in takes if take < sample_time and not jitter)})
    times = (sample_time, *fixed, *takes, jitter / CELLS)
    # Twice as fine with jitter: fixed times are at even ticks then, and a
    # measurement at an odd one, so the two never fall together.
    denominator = math.lcm(*(time.denominator for time in times)) * (2 if jitter else 1)
    # int64 in the compiled loop wraps around without an error.
    if denominator > MAX_TICKS_PER_SECOND:
        message = f"Sample time and delays have no common grid of {1 / MAX_TICKS_PER_SECOND:g} s or coarser."
        raise InputError(f"{message} Give them with fewer digits.", "bad-time")

    def ticks(time: Fraction) -> int:
        return int(time * denominator)

    # What is fixed is at even ticks then, and a measurement at an odd one.
    shift = np.zeros(1, dtype=np.int64) if cells is None else cells[1:] * ticks(jitter / CELLS) + 1
    moved = sorted(set(takes)) if jitter else []
    begins = [*(np.full(len(shift), ticks(time)) for time in fixed), *(ticks(take) - shift for take in moved)]
    offset = np.sort(np.column_stack(begins).astype(np.int64))
    ends = np.column_stack([offset[:, 1:], np.full(len(shift), ticks(sample_time))])
    taken = np.column_stack([ticks(take) - shift for take in takes])
    # In the parts before the arrival the command of the sample before still acts.
    late = offset[:, :, None] < np.array([ticks(time) for time in arrival])
    return Plan(
        interval=ticks(sample_time),
        denominator=denominator,
        offset=np.ascontiguousarray(offset),
        step=np.ascontiguousarray((ends - offset) / denominator),
        drive_lag=np.ascontiguousarray(late + np.array([int(whole) for whole in whole_drive], dtype=np.int64)),
        sample_part=np.argmax(ends[:, :, None] == taken[:, None, :], axis=1).astype(np.int64),
        sensor_lag=np.array([int(whole) for whole in whole_sensor], dtype=np.int64),
    )
