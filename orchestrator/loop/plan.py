"""Transport delays, turned into a plan for every sample interval: where the plant's step is split, which torque acts
in each part, where a delayed measurement is taken.

Times are exact fractions, so that a delay of 0.3 samples splits a step at 0.3 and a delay of a whole sample does not
split it at all. The plan is the same for every sample interval; the loop applies it by the sample's index.
"""

from __future__ import annotations

import math
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..errors import InputError
from .scenario import Delays

FINEST = 10**14
"""Largest number of ticks per second: 64-bit integers then count to 92,000 s."""


class Plan(NamedTuple):
    """The parts of one sample interval, for the compiled loop.

    The time of part p in interval k is ``(k * interval + offset[p]) / denominator`` seconds: integers, never
    accumulated. In part p axis i is driven by the command of sample ``k - drive_lag[p, i]``. Axis i is measured at
    the end of part ``sample_part[i]``, and the controller at sample k is given the value taken for sample
    ``k - sensor_lag[i]``.
    """

    interval: int
    denominator: int
    offset: np.ndarray
    """int64, shape (parts,)."""
    step: np.ndarray
    """Length of each part [s], shape (parts,)."""
    drive_lag: np.ndarray
    """int64, shape (parts, 2)."""
    sample_part: np.ndarray
    """int64, shape (2,)."""
    sensor_lag: np.ndarray
    """int64, shape (2,)."""


def make_plan(sample_time: Fraction, drive: Delays, sensor: Delays, longest: Fraction | None = None) -> Plan:
    """The plan for a sample time and the transport delays per axis, all exact and in seconds.

    No part is longer than ``longest``; by default there is no such limit.

    A command of sample k reaches the motor at t_k + delay; a measurement for sample k is taken at t_k minus the
    fractional part of the sensor's delay and given to the controller so many whole samples later.

    Raises :class:`InputError` if the times have no common grid that integers can count.
    """
    whole_drive, arrival = zip(*(divmod(delay, sample_time) for delay in drive), strict=True)
    whole_sensor, early = zip(*(divmod(delay, sample_time) for delay in sensor), strict=True)
    takes = [sample_time - part for part in early]
    holds = math.ceil(sample_time / longest) if longest else 1
    regular = [number * sample_time / holds for number in range(holds)]
    begins = sorted({*regular, *arrival, *(take for take in takes if take < sample_time)})
    ends = [*begins[1:], sample_time]
    denominator = math.lcm(sample_time.denominator, *(time.denominator for time in begins))
    if denominator > FINEST:
        message = f"Sample time and delays have no common grid of {1 / FINEST:g} s or coarser."
        raise InputError(f"{message} Give them with fewer digits.", "bad-time")

    def ticks(time: Fraction) -> int:
        return int(time * denominator)

    return Plan(
        interval=ticks(sample_time),
        denominator=denominator,
        offset=np.array([ticks(time) for time in begins], dtype=np.int64),
        step=np.array([float(end - begin) for begin, end in zip(begins, ends, strict=True)]),
        drive_lag=np.array(
            [
                [int(whole) + (begin < late) for whole, late in zip(whole_drive, arrival, strict=True)]
                for begin in begins
            ],
            dtype=np.int64,
        ),
        sample_part=np.array([ends.index(take) for take in takes], dtype=np.int64),
        sensor_lag=np.array([int(whole) for whole in whole_sensor], dtype=np.int64),
    )
