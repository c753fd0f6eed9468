"""Convex programs with second-order cones, solved by Clarabel; SciPy solves linear programs, which know no norm."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import clarabel
import numpy as np
from scipy.sparse import csc_matrix


class Size(NamedTuple):
    """``|x[part]| <= x[level]``."""

    part: slice
    level: int


class Ball(NamedTuple):
    """``|rows x[part] + constants| <= radius``."""

    part: slice
    rows: np.ndarray
    constants: np.ndarray
    radius: float


class Minimum(NamedTuple):
    """The point that was found, its objective, and a lower bound of all objectives: that of the dual program."""

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
        Shapes (groups, size, n) and (groups, size).
    level : int
        Index of the variable that limits all of these norms.
    linear, offsets : numpy.ndarray
        Shapes (inequalities, n) and (inequalities,).
    sizes, balls : list
        Further constraints.
    """

    cost: np.ndarray
    rows: np.ndarray
    constants: np.ndarray
    level: int
    linear: np.ndarray
    offsets: np.ndarray
    sizes: list[Size] = field(default_factory=list)
    balls: list[Ball] = field(default_factory=list)

    def minimize(self) -> Minimum:
        """The minimum. Raises ``ArithmeticError`` where the solver finds none."""
        blocks, constants = [self.linear], [self.offsets]
        cones = [clarabel.NonnegativeConeT(len(self.offsets))]
        unit = np.eye(len(self.cost))
        for rows, offset in zip(self.rows, self.constants, strict=True):
            blocks += [unit[self.level, None], rows]
            constants += [np.zeros(1), offset]
            cones.append(clarabel.SecondOrderConeT(1 + len(rows)))
        for part, level in self.sizes:
            blocks += [unit[level, None], unit[part]]
            constants += [np.zeros(1 + len(unit[part]))]
            cones.append(clarabel.SecondOrderConeT(1 + len(unit[part])))
        for part, rows, offset, radius in self.balls:
            blocks += [np.zeros((1, len(unit))), rows @ unit[part]]
            constants += [np.array([radius]), offset]
            cones.append(clarabel.SecondOrderConeT(1 + len(rows)))
        settings = clarabel.DefaultSettings()
        settings.verbose = False
        none, matrix, vector = (
            csc_matrix((len(unit), len(unit))),
            csc_matrix(-np.vstack(blocks)),
            np.concatenate(constants),
        )
        solved = clarabel.DefaultSolver(none, self.cost, matrix, vector, cones, settings).solve()
        if solved.status != clarabel.SolverStatus.Solved:
            raise ArithmeticError(f"no minimum: {solved.status}")
        return Minimum(np.array(solved.x), solved.obj_val, solved.obj_val_dual)
