"""The dither that keeps friction from holding the motors while the arm still rings.

A motor held by friction cannot damp its arm. Shaken fast enough that the arm does not notice, it moves all the time,
and to slow torques its Coulomb friction looks like a small viscous one. The dither follows the largest recent
estimate of the TCP error and ends before the error is worth its noise: at rest the motors stand still.

Plain arithmetic only, so that the tuning compiles the very function that the FMU interprets.
"""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import NamedTuple


class Dither(NamedTuple):
    """Constants of the dither."""

    amplitude_1: float
    """Torque of axis 1 at full strength [N.m]."""
    amplitude_2: float
    """Torque of axis 2 at full strength [N.m]."""
    period: float
    """Samples of one oscillation."""
    off: float
    """Level [m] below which there is none."""
    full: float
    """Level [m] from which on it has full strength."""
    forget: float
    """Factor by which the level falls in a sample."""


def dither(constants, level, error, k):
    """The new level [m] and the torques of axis 1 and 2 [N.m] at sample ``k``; ``error`` is the estimated one [m]."""
    amplitude_1, amplitude_2, period, off, full, forget = constants
    level = max(error, forget * level)
    strength = min(max((level - off) / (full - off), 0.0), 1.0)
    wave = strength * math.sin(2.0 * math.pi * (k % period) / period)
    return level, amplitude_1 * wave, amplitude_2 * wave


def read_dither(file: Path) -> Dither:
    """The dither in a data file of the tuning script."""
    return Dither(**json.loads(file.read_text(encoding="utf-8"))["dither"])
