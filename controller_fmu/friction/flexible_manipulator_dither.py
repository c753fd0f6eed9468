"""The dither that keeps friction from holding the motors while the arm still rings.

A motor held by friction cannot damp its arm. Shaken fast enough that the arm does not notice, it moves all the time,
and to slow torques its Coulomb friction looks like a small viscous one. The dither follows the largest recent
estimate of the TCP error and ends before the error is worth its noise: at rest the motors stand still.
"""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple


class Dither(NamedTuple):
    """The dither's parameters; annotations as in flexible_manipulator_lqg/interface.py."""

    amplitude: Annotated[tuple[float, float], "N.m", "Torque of the dither at full strength", 0.0]
    period: Annotated[float, "s", "Period of the dither", 1e-9]
    off: Annotated[float, "m", "Level of the TCP error below which there is no dither", 0.0]
    rise: Annotated[float, "m", "From that level to the one with full strength", 1e-9]
    memory: Annotated[float, "s", "Time constant with which the level fades", 1e-9]


class Wave(NamedTuple):
    """What a step needs of them."""

    amplitude: tuple[float, float]
    """[N.m]."""
    period: float
    """[samples]."""
    off: float
    """Level [m] below which there is none."""
    full: float
    """Level [m] from which on it has full strength."""
    forget: float
    """Factor by which the level falls in a sample."""


def wave(of: Dither, T_s: float) -> Wave:
    """The dither at the sample time ``T_s`` [s]."""
    return Wave(of.amplitude, of.period / T_s, of.off, of.off + of.rise, math.exp(-T_s / of.memory))


def dither(constants: Wave, level: float, error: float, k: int) -> tuple[float, float, float]:
    """The new level [m] and the torques of axis 1 and 2 [N.m] at sample ``k``; ``error`` is the estimated one [m]."""
    amplitude, period, off, full, forget = constants
    level = max(error, forget * level)
    strength = min(max((level - off) / (full - off), 0.0), 1.0)
    shake = strength * math.sin(2.0 * math.pi * (k % period) / period)
    return level, amplitude[0] * shake, amplitude[1] * shake
