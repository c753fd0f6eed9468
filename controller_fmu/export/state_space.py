"""A controller FMU of matrices, compiled."""

from __future__ import annotations

import math
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np

from controller_fmu.errors import ScheduleError, ShapeError, located
from controller_fmu.export.archive import check_target, target_of
from controller_fmu.export.c_fmu import c_fmu
from controller_fmu.export.description import parse, to_bytes
from controller_fmu.export.systems import contents, real, stacked

# Imports inside functions: SciPy is loaded by those who need it.

TEMPLATES = Path(__file__).resolve().parents[1] / "state_space"
INTERPOLATIONS = ("nearest", "linear")


def controller_from_state_space(
    A: Any,
    B: Any = None,
    C: Any = None,
    D: Any = None,
    T_s: float | None = None,
    *,
    out: str | Path,
    method: Literal["zoh", "tustin"] | None = None,
    points: Any = None,
    interpolation: Literal["nearest", "linear"] = "nearest",
    anti_windup: Any = None,
    torque_limit: tuple[float, float] = (35.0, 20.0),
    unstable: bool = False,
) -> Path:
    """Build the FMU of a linear controller, or of a schedule of them, and return its path ``out``.

    At each sample, with the states x, zero at the start, and the error e::

        e   = q_m_ref - q_m                                   [rad]
        u_m = u_m0 + C x + D e, within +-torque_limit         [N.m]
        x+  = A x + B e + anti_windup (u_m - (u_m0 + C x + D e))

    so that a feedback is negative with positive gains, and u_m0, which the benchmark gives, carries gravity. The torque
    of sample k belongs to the angle measured at sample k; that it arrives a sample later is the loop's delay.

    Parameters
    ----------
    A, B, C, D : array_like
        Shapes (n, n), (n, 2), (2, n), (2, 2), or (P, ...) for a schedule; D is zero if left out. Instead of the four, A
        may be a ``StateSpace`` of python-control, a system of ``scipy.signal``, a sequence of such systems for a
        schedule, or a ``.mat``, ``.npz`` or ``.json`` file with the names A, B, C, D, T_s, and perhaps points and
        anti_windup.
    T_s : float, optional
        Sample time [s], where the system does not say it.
    out : path
        The FMU to write; its name becomes the model's, and must be a C identifier.
    method : str, optional
        How a continuous system is sampled: ``"zoh"`` or ``"tustin"``. It is not, if left out.
    points : array_like, optional
        For a schedule, motor angles q_m_ref [rad] that the controllers are made for, shape (P, 2):
        ``LinearModel.at.q_m``. The schedule is read at the end of initialization, as the reference is constant.
    interpolation : str
        ``"nearest"`` takes the controller of the nearest point; ``"linear"`` interpolates all matrices over the
        Delaunay triangles of the points, which needs states that mean the same in all controllers. Beyond the points,
        it keeps to the best triangle's border.
    anti_windup : array_like, optional
        Gain from the torque that the limit cuts off to the sampled states, shape (n, 2) or (P, n, 2); zero if left
        out. With B of the plant, an observer sees the torque that the motors get.
    torque_limit : tuple of float
        The drive's limits [N.m].
    unstable : bool
        Whether a controller may be unstable by itself.

    Raises
    ------
    ShapeError
        If the matrices do not fit each other or two inputs and outputs, or are not finite.
    SampleTimeError
        If the sample time is missing or contradicts itself, or a system is continuous and ``method`` missing.
    UnstableError
        If a controller has a pole outside the unit circle, and that was not allowed.
    ScheduleError
        If the points are missing, or cannot be interpolated between.
    SystemFileError
        If a file cannot be read.
    NoCompilerError
        If this machine has no C compiler.
    BuildError
        Whatever else is wrong with ``out`` or the compiler.
    """
    target, system = target_of(out), A
    check_target(target)
    if isinstance(A, str | Path):
        system = contents(Path(A))
        points = system.get("points") if points is None else points
        anti_windup = system.get("anti_windup") if anti_windup is None else anti_windup
    with located(Path(A) if isinstance(A, str | Path) else target):
        law = stacked(system, B, C, D, T_s, method, unstable)
        count, states = law.B.shape[:2]
        backs = np.zeros((count, states + 2, 2))
        if anti_windup is not None:
            backs[:, :states] = _shaped("anti_windup", anti_windup, (count, states, 2), (states, 2))
        data = {
            "T_s": law.T_s,
            "limit": _shaped("torque_limit", torque_limit, (2,)).tolist(),
            "is_linear": interpolation == "linear",
            **_schedule(points, count, interpolation),
            "laws": np.block([[law.A, law.B], [law.C, law.D]]).tolist(),
            "backs": backs.tolist(),
        }
    root = parse((TEMPLATES / "modelDescription.xml").read_bytes())
    root.find("DefaultExperiment").set("stepSize", repr(law.T_s))  # type: ignore[union-attr]  # it is there
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as name:
        folder = Path(name)
        (folder / "modelDescription.xml").write_bytes(to_bytes(root))
        (folder / "gains.h").write_text(_header(data), encoding="utf-8")
        return c_fmu([TEMPLATES / "model.c", folder / "gains.h"], folder / "modelDescription.xml", target)


def _shaped(name: str, value: Any, *shapes: tuple[int, ...]) -> np.ndarray:
    """``value`` as an array of one of the ``shapes``, without NaN."""
    array = real(name, value)
    if array.shape not in shapes:
        raise ShapeError(f"{name} has the shape {array.shape}, not {' or '.join(map(str, shapes))}", value=name)
    if np.any(np.isnan(array)):
        raise ShapeError(f"{name} holds what is not a number", value=name)
    return array


def _schedule(points: Any, count: int, interpolation: str) -> dict[str, Any]:
    """The points and, to interpolate between them, their triangles."""
    if interpolation not in INTERPOLATIONS:
        what = f"there is no interpolation {interpolation!r}"
        raise ScheduleError(what, value=interpolation, nearest=INTERPOLATIONS)
    if points is None:
        if count > 1:
            raise ScheduleError(f"there are {count} controllers, and no points that they are for", value="points")
        points = np.zeros((1, 2))
    points = _shaped("points", points, (count, 2))
    return {"points": points.tolist(), "cells": _cells(points) if interpolation == "linear" else []}


def _cells(points: np.ndarray) -> list[dict[str, Any]]:
    from scipy.spatial import Delaunay, QhullError

    try:
        triangles = Delaunay(points)
    except (QhullError, ValueError):  # fewer than three, or infinite
        simplices = []
    else:
        simplices = list(zip(triangles.simplices, triangles.transform, strict=True))
    cells = [
        {"corner": corner.tolist(), "inverse": transform[:2].tolist(), "origin": transform[2].tolist()}
        for corner, transform in simplices
        if np.all(np.isfinite(transform))
    ]
    if not cells:
        remedy = "give three that do not lie on a line, or use the nearest one"
        raise ScheduleError("the points span no triangle to interpolate in", value="points", remedy=remedy)
    return cells


def _header(data: dict[str, Any]) -> str:
    """The data as C, the matrices by columns."""
    laws, backs = (np.swapaxes(np.array(data[name]), 1, 2).tolist() for name in ("laws", "backs"))
    nothing = {"corner": [0, 0, 0], "inverse": [[0.0, 0.0]] * 2, "origin": [0.0, 0.0]}
    cells = [[cell["corner"], cell["inverse"], cell["origin"]] for cell in data["cells"] or [nothing]]
    return f"""/* Written by the build: the controller's matrices and where they hold. */
#ifndef GAINS_H
#define GAINS_H

enum {{ ROWS = {len(laws[0])}, POINTS = {len(laws)}, CELLS = {len(cells)}, IS_LINEAR = {int(data["is_linear"])} }};

/* A triangle of points; weights of the first two are inverse (q - origin). */
typedef struct {{
    unsigned corner[3];
    double inverse[2][2], origin[2];
}} Cell;

static const double T_S = {data["T_s"]!r}; /* [s] */
static const double LIMIT[2] = {_braced(data["limit"])}; /* [N.m] */
static const double POINT[POINTS][2] = {_braced(data["points"])}; /* q_m_ref [rad] */
static const Cell CELL[CELLS] = {_braced(cells)};
static const double LAW[POINTS][ROWS][ROWS] = {_braced(laws)};
static const double BACK[POINTS][2][ROWS] = {_braced(backs)};

#endif
"""


def _braced(value: Iterable[Any] | float) -> str:
    """Nested sequences of numbers as an initializer in C, lines of one row each."""
    if not isinstance(value, Sequence):
        return "INFINITY" if value == math.inf else repr(value)
    inner = [_braced(item) for item in value]
    return "{" + (",\n" if any(isinstance(item, Sequence) for item in value) else ", ").join(inner) + "}"
