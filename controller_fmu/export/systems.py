"""Linear systems of python-control, SciPy and files, as the sampled controllers that they are meant to be."""

from __future__ import annotations

import io
import json
import math
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from controller_fmu.errors import SampleTimeError, ShapeError, SystemFileError, UnstableError

# Imports inside functions: SciPy is loaded by those who need it.

MATRICES = ("A", "B", "C", "D")
METHODS = {"zoh": "zoh", "tustin": "bilinear"}
"""Ways to sample a continuous system, by their names in SciPy."""

SAMPLE_TIME = ("T_s", "Ts", "dt")
"""Names that the sample time may have in a file."""

GROWTH = 1e-6
"""A pole that is farther outside the unit circle is unstable; rounding moves double integrators by less."""


class LinearControllers(NamedTuple):
    """Sampled controllers, x+ = A x + B e, v = C x + D e, one for each of P points.

    Shapes (P, n, n), (P, n, 2), (P, 2, n), (P, 2, 2); ``T_s`` [s].
    """

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray
    T_s: float


def contents(file: Path) -> dict[str, Any]:
    """The arrays in a ``.mat``, ``.npz`` or ``.json`` file by name; what MATLAB stacks last is put first.

    Raises :class:`SystemFileError` if it cannot be read, or has no A, B, C.
    """
    try:
        if file.suffix == ".mat":
            arrays = {
                name: np.moveaxis(value, -1, 0) if np.ndim(value) == 3 else value
                for name, value in _of_matlab(file).items()
            }
        elif file.suffix == ".npz":
            with np.load(file) as stored:
                arrays = dict(stored)
        else:
            arrays = json.loads(file.read_text(encoding="utf-8"))
    except Exception as problem:  # NumPy and zipfile have all kinds for damaged files
        raise SystemFileError(f"cannot be read: {problem}", str(file)) from None
    missing = [name for name in MATRICES[:3] if not isinstance(arrays, Mapping) or name not in arrays]
    if missing:
        remedy = "save A, B, C, D and T_s under these names, in MATLAB as matrices: [A, B, C, D] = ssdata(K)"
        raise SystemFileError(f"has no {' and no '.join(missing)}", str(file), value=missing[0], remedy=remedy)
    return dict(arrays)


_READER = """
import io, sys
sys.path = [folder for folder in sys.path if folder]  # not of the folder where the user is
import numpy as np
from scipy.io import loadmat
try:
    read = loadmat(sys.argv[1]).items()
except Exception as problem:
    sys.exit(str(problem))
plain = {name: value for name, value in read if not name.startswith("__") and np.asarray(value).dtype.kind in "biufcU"}
stored = io.BytesIO()
np.savez(stored, **plain)
sys.stdout.buffer.write(stored.getvalue())
"""


def _of_matlab(file: Path) -> dict[str, Any]:
    """The arrays of numbers in a ``.mat`` file by name."""
    # In a process of its own, since a damaged file can end it: SciPy 1.17 died of a segmentation fault at one of 500.
    reader = [sys.executable, "-c", _READER, str(file.resolve())]
    done = subprocess.run(reader, capture_output=True, stdin=subprocess.DEVNULL, check=False)
    if done.returncode:
        told = done.stderr.decode(errors="replace").strip().splitlines()[-1:]
        raise ValueError(told[0] if told and done.returncode > 0 else "the file is damaged")
    with np.load(io.BytesIO(done.stdout)) as stored:
        return dict(stored)


def stacked(
    system: Any, B: Any, C: Any, D: Any, T_s: float | None, method: str | None, unstable: bool = False
) -> LinearControllers:
    """The controllers of matrices (2 or 3 dimensions), of the contents of a file, of a system, or of several.

    Raises:
        ShapeError: the matrices do not fit each other or two errors and two torques, or are not finite.
        SampleTimeError: the sample time is missing or contradicts itself, or ``method`` is missing, or has no use.
        UnstableError: a controller has a pole outside the unit circle, and may not be ``unstable``.
    """
    parts: list[tuple[Any, Any, Any, Any, float | None]]
    T_s = _number(T_s)
    if B is not None:
        parts = [(system, B, C, D, 0.0 if method else T_s)]
    elif isinstance(system, Mapping):
        of_system = _number(next((system[name] for name in SAMPLE_TIME if name in system), None))
        parts = [(system["A"], system["B"], system["C"], system.get("D"), of_system)]
    else:
        several = system if isinstance(system, Sequence) else [system]
        parts = [_matrices(one) for one in several]
    times = {_sample_time(of_system, T_s, method) for *_, of_system in parts}
    if len(times) != 1:
        raise SampleTimeError("the systems have different sample times", value=", ".join(f"{time:g}" for time in times))
    blocks = [_checked(*part[:4]) for part in parts]
    if len({block[0].shape[1:] for block in blocks}) != 1:
        raise ShapeError("the controllers of a schedule must have the same number of states")
    A, B, C, D = (np.concatenate(matrices) for matrices in zip(*blocks, strict=True))
    time = times.pop()
    if method is not None:
        A, B, C, D = _discretized((A, B, C, D), time, method)
    for index, matrix in enumerate(A if A.shape[1] and not unstable else ()):
        radius = float(np.abs(np.linalg.eigvals(matrix)).max())
        if radius > 1.0 + GROWTH:
            which = f"controller {index + 1}" if len(A) > 1 else "the controller"
            what = f"{which} is unstable: it has a pole of absolute value {radius:.6g}"
            remedy = "its torque runs away while the drive is at its limit: change the weights of its design"
            raise UnstableError(what, value=f"{radius:.6g}", remedy=remedy)
    return LinearControllers(A, B, C, D, time)


def _number(value: Any) -> float | None:
    """A sample time that is given [s]; None if there is none."""
    try:
        return None if value is None else float(np.squeeze(value))
    except (TypeError, ValueError):
        raise SampleTimeError("the sample time is not a number", value=str(value)) from None


def _matrices(system: Any) -> tuple[Any, Any, Any, Any, float | None]:
    """Matrices and sample time of a system of python-control or SciPy: 0 if continuous, None if it is not known."""
    system = system.to_ss() if hasattr(system, "to_ss") else system
    if not all(hasattr(system, name) for name in MATRICES):
        raise ShapeError(f"is not a linear system with A, B, C and D: {type(system).__name__}")
    dt = getattr(system, "dt", None)
    return (*(getattr(system, name) for name in MATRICES), None if dt is True else float(dt or 0.0))


def _sample_time(of_system: float | None, given: float | None, method: str | None) -> float:
    """The sample time [s] of a system that states ``of_system`` (0 if it is continuous)."""
    if method is not None and method not in METHODS:
        raise SampleTimeError(f"there is no method {method!r}", value=method, nearest=tuple(METHODS))
    if method is not None and of_system != 0.0:
        raise SampleTimeError("a sampled system needs no method", value=method)
    if method is None and of_system == 0.0:
        remedy = f"say how to sample it: method {' or '.join(map(repr, METHODS))}"
        raise SampleTimeError("the system is continuous", remedy=remedy)
    if of_system and given is not None and not math.isclose(of_system, given, rel_tol=1e-9):
        raise SampleTimeError(f"the system has the sample time {of_system:g} s, not {given:g} s", value=f"{given:g}")
    T_s = of_system or given
    if T_s is None or not 0.0 < T_s < math.inf:
        raise SampleTimeError("the sample time is missing, or not positive", value=str(T_s), remedy="give T_s [s]")
    return float(T_s)


def _checked(A: Any, B: Any, C: Any, D: Any) -> list[np.ndarray]:
    """The matrices with a dimension for the points in front; D is zero if it is None."""
    matrices = [real(name, matrix) for name, matrix in zip(MATRICES, (A, B, C, 0.0 if D is None else D), strict=True)]
    matrices = [matrix[None] if matrix.ndim == 2 else matrix for matrix in matrices]
    points, states = max(len(matrix) if matrix.ndim else 1 for matrix in matrices), matrices[0].shape[-1:] or (0,)
    if D is None:
        matrices[3] = np.zeros((points, 2, 2))
    for name, matrix, shape in zip(MATRICES, matrices, (2 * states, (*states, 2), (2, *states), (2, 2)), strict=True):
        if matrix.shape != (points, *shape):
            what = f"{name} has the shape {matrix.shape[-2:]}, not {shape}: two errors in, two torques out"
            if matrix.shape[1:] == shape:
                what = f"there are {len(matrix)} matrices {name}, not {points}"
            raise ShapeError(what, value=name)
        if not np.all(np.isfinite(matrix)):
            raise ShapeError(f"{name} holds what is not a finite number", value=name)
    return matrices


def real(name: str, value: Any) -> np.ndarray:
    """``value`` as an array of real numbers."""
    try:
        if np.iscomplexobj(value):  # which raises where the rows are of different lengths
            raise ShapeError(f"{name} is complex", value=name)
        return np.array(value, dtype=float)
    except (TypeError, ValueError) as problem:
        raise ShapeError(f"{name} is not made of numbers: {problem}", value=name) from None


def _discretized(continuous: Sequence[np.ndarray], T_s: float, method: str) -> tuple[np.ndarray, ...]:
    from scipy.signal import cont2discrete

    sampled = [cont2discrete(system, T_s, METHODS[method])[:4] for system in zip(*continuous, strict=True)]
    return tuple(np.stack(matrices) for matrices in zip(*sampled, strict=True))
