"""Where the elementary functions are tried: over their ranges, at the ends of these, and where errors are largest."""

import math
from dataclasses import dataclass

import numpy as np

from plant_fmu.flexible_manipulator import formulas

COUNT = 1_000_000
"""Of points for a function, at the least."""


def neighbours(values):
    """Each value with the numbers next to it."""
    values = np.asarray(values, dtype=float)
    with np.errstate(over="ignore"):
        return np.concatenate([values, np.nextafter(values, -np.inf), np.nextafter(values, np.inf)])


def within(values, low, high):
    return values[(values >= low) & (values <= high)]


def angles(chance):
    most = formulas.ANGLE_MAX
    small = np.exp(chance.uniform(math.log(1e-300), 0.0, COUNT // 10)) * chance.choice((-1.0, 1.0), COUNT // 10)
    everywhere = chance.uniform(-most, most, COUNT // 2)
    few = chance.uniform(-8.0, 8.0, COUNT // 2)
    return np.concatenate([within(neighbours([0.0, -0.0, most, -most]), -most, most), small, everywhere, few])


def exponents(chance):
    low, high = formulas.EXP_MIN, formulas.EXP_MAX
    ends = within(neighbours([low, high, 0.0, math.log(2.0) / 128.0]), low, high)
    return np.concatenate([ends, chance.uniform(low, high, COUNT // 2), chance.uniform(-2.0, 2.0, COUNT // 2)])


def positives(chance):
    low, high = formulas.LOG_MIN, formulas.LOG_MAX
    ends = within(neighbours([low, high, 1.0, formulas.SQRT_1_2, 2.0 * formulas.SQRT_1_2]), low, high)
    everywhere = np.exp(chance.uniform(math.log(low) + 1e-9, math.log(high) - 1e-9, COUNT // 2))
    near_1 = 1.0 + chance.choice((-1.0, 1.0), COUNT // 4) * np.exp(chance.uniform(-36.0, -1.0, COUNT // 4))
    return np.concatenate([ends, everywhere, near_1, chance.uniform(0.5, 2.0, COUNT // 4)])


def lengths(chance):
    """Of any sizes, of similar sizes, and some that are 0."""
    x = 10.0 ** chance.uniform(-140.0, 140.0, COUNT)
    y = 10.0 ** chance.uniform(-140.0, 140.0, COUNT)
    y[COUNT // 4 :] = x[COUNT // 4 :] * chance.uniform(0.0, 1.0, COUNT - COUNT // 4)
    ends = np.array([(1e-140, 1e-140), (1e140, 1e140), (1e140, 1e-140), (3.0, 4.0), (0.0, 5.0), (0.0, 0.0)]).T
    y = np.where((y < 1e-140) | (y > 1e140), 0.0, y)
    signs = chance.choice((-1.0, 1.0), (2, COUNT))
    return np.concatenate([ends[0], signs[0] * x]), np.concatenate([ends[1], signs[1] * y])


@dataclass(frozen=True)
class Points:
    """Arguments of a function."""

    x: np.ndarray
    y: np.ndarray


def points(name):
    chance = np.random.default_rng(5)
    if name == "hypot":
        return Points(*lengths(chance))
    x = {"sin": angles, "cos": angles, "exp": exponents, "log": positives}[name](chance)
    return Points(x, np.zeros_like(x))
