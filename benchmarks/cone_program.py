"""Convex programs with second-order cones, by a barrier method, with a lower bound of the minimum.

SciPy solves linear programs; a bound on a Euclidean norm needs a cone. The method is that of Boyd and Vandenberghe,
Convex Optimization (2004), Section 11.3, on dense matrices: for programs of up to some two thousand variables.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

CENTRED, SHRINK, SMALLEST = 0.1, 8.0, 1e-9
"""Square of Newton's decrement at which a point counts as central, the factor from one barrier parameter to the next,
and the smallest step of a line search."""


class Size(NamedTuple):
    """``|x[part]| <= x[level]``."""

    part: slice
    level: int


class Quadratic(NamedTuple):
    """``x' P x + 2 l x + c <= limit`` for ``x = x[part]``."""

    part: slice
    P: np.ndarray
    l: np.ndarray  # noqa: E741
    c: float
    limit: float


class Minimum(NamedTuple):
    """The point that was found, its objective, and a lower bound of all objectives."""

    x: np.ndarray
    value: float
    bound: float


@dataclass
class ConeProgram:
    """Minimize ``cost x`` with ``|rows[i] x + constants[i]| <= x[level]``, ``linear x + offsets >= 0`` and more.

    Parameters
    ----------
    cost : numpy.ndarray
        Shape (n,).
    rows, constants : numpy.ndarray
        Shapes (groups, size, n) and (groups, size); the columns of variables in ``sizes`` and of ``level`` are zero.
    level : int
        Index of the variable that limits all of these norms.
    linear, offsets : numpy.ndarray
        Shapes (inequalities, n) and (inequalities,).
    sizes, quadratics : list
        Further constraints.
    """

    cost: np.ndarray
    rows: np.ndarray
    constants: np.ndarray
    level: int
    linear: np.ndarray
    offsets: np.ndarray
    sizes: list[Size] = field(default_factory=list)
    quadratics: list[Quadratic] = field(default_factory=list)

    @property
    def parameter(self) -> int:
        """Of the barrier: 2 a cone, 1 an inequality."""
        return 2 * (len(self.rows) + len(self.sizes)) + len(self.quadratics) + len(self.offsets)

    def slack(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """What the logarithms of the barrier are taken of, positive inside; and the vectors in the first cones."""
        vectors = (self.rows.reshape(-1, len(x)) @ x).reshape(self.constants.shape) + self.constants
        cones = x[self.level] ** 2 - (vectors**2).sum(axis=1)
        sizes = [x[own.level] ** 2 - x[own.part] @ x[own.part] for own in self.sizes]
        squares = [q.limit - x[q.part] @ (q.P @ x[q.part] + 2.0 * q.l) - q.c for q in self.quadratics]
        return np.concatenate([cones, sizes, squares, self.linear @ x + self.offsets]), vectors

    def inside(self, x: np.ndarray) -> bool:
        """Whether ``x`` fulfils all constraints strictly."""
        return bool(min(x[[self.level, *(own.level for own in self.sizes)]]) > 0.0 and self.slack(x)[0].min() > 0.0)

    def barrier(self, x: np.ndarray, mu: float) -> float:
        """``cost x / mu`` minus the sum of the logarithms."""
        return float(self.cost @ x / mu - np.log(self.slack(x)[0]).sum()) if self.inside(x) else math.inf

    def derivatives(self, x: np.ndarray, mu: float) -> tuple[np.ndarray, np.ndarray]:
        """Gradient and Hessian matrix of :meth:`barrier`."""
        groups, size, n = self.rows.shape
        slack, vectors = self.slack(x)
        gradient, hessian = self.cost / mu, np.zeros((n, n))
        slopes = []  # of each slack; the Hessian of -log s is (slope slope' / s - second derivative) / s
        cones, t = slack[:groups], x[self.level]
        scaled = self.rows.reshape(-1, n) * np.repeat(np.sqrt(2.0 / cones), size)[:, None]
        hessian += scaled.T @ scaled
        hessian[self.level, self.level] -= (2.0 / cones).sum()
        own = -2.0 * np.einsum("gi,gin->gn", vectors, self.rows)
        own[:, self.level] += 2.0 * t
        slopes.append(own)
        for constraint, value in zip(self.sizes, slack[groups:], strict=False):
            slope = np.zeros(n)
            slope[constraint.part] = -2.0 * x[constraint.part]
            slope[constraint.level] = 2.0 * x[constraint.level]
            slopes.append(slope[None])
            places = np.arange(n)[constraint.part]
            hessian[places, places] += 2.0 / value
            hessian[constraint.level, constraint.level] -= 2.0 / value
        for square, value in zip(self.quadratics, slack[groups + len(self.sizes) :], strict=False):
            slope = np.zeros(n)
            slope[square.part] = -2.0 * (square.P @ x[square.part] + square.l)
            slopes.append(slope[None])
            hessian[square.part, square.part] += 2.0 * square.P / value
        slopes.append(self.linear)
        relative = np.vstack(slopes) / slack[:, None]
        return gradient - relative.sum(axis=0), hessian + relative.T @ relative

    def minimize(self, start: np.ndarray, accuracy: float = 2e-3) -> Minimum:
        """The minimum from a point inside, within a share ``accuracy`` of it.

        The bound is that of a point near the central path: its objective is above the minimum by at most
        ``mu (nu + (lambda + sqrt(nu)) lambda / (1 - lambda))`` with the barrier's parameter ``nu`` and Newton's
        decrement ``lambda`` (Nesterov and Nemirovskii, Interior-Point Polynomial Algorithms, 1994).
        """
        x, nu = start.copy(), self.parameter
        mu = float(self.cost @ x) / nu
        while True:
            while True:
                gradient, hessian = self.derivatives(x, mu)
                step = -cho_solve(cho_factor(hessian, lower=True), gradient)
                squared, length, before = float(-gradient @ step), 1.0, self.barrier(x, mu)
                if squared < CENTRED:
                    break
                while self.barrier(x + length * step, mu) > before - 0.1 * length * squared and length > SMALLEST:
                    length /= 2.0
                if length <= SMALLEST:
                    raise ArithmeticError("no step lowers the barrier")
                x = x + length * step
            decrement, value = math.sqrt(max(squared, 0.0)), float(self.cost @ x)
            gap = mu * (nu + (decrement + math.sqrt(nu)) * decrement / (1.0 - decrement))
            if gap <= accuracy * value:
                return Minimum(x, value, value - gap)
            mu /= SHRINK
