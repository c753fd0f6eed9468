"""The few trajectories a run keeps for its report: thinned out, and stored beside the results.

A thinned signal keeps the smallest and the largest sample of every interval, at the times they were taken. So no peak
is lost and every point shown is one that was computed; what lies between two points is not.
"""

from __future__ import annotations

import io
import json
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ..benchmark.case import Case
from ..cosim.trajectory import Trajectory
from ..errors import InputError
from .files import TRAJECTORIES, write_bytes

MOTION_INTERVALS, TORQUE_INTERVALS = 1800, 900
"""Intervals that the signals are thinned out to."""

EXAMPLE, SPREAD = "example", "spread"
"""Roles beside the criteria (``B5``) and requirements (``A2 axis 2``): Figures 9-10, and 11-12 of the paper."""


@dataclass(frozen=True)
class About:
    """What was recorded. Angles and times in SI units; ``force`` [N], ``chirp`` start and stop [s] and start and stop
    frequency [Hz]; ``window`` [s] is when the force acts. ``roles`` say what the recording is shown for."""

    id: str
    roles: tuple[str, ...]
    configuration: int
    q_a: tuple[float, float]
    system: str
    test: str
    duration: float
    force: tuple[float, float]
    window: tuple[float, float]
    chirp: tuple[float, float, float, float]
    u_m0: tuple[float, float]
    status: str
    time: float
    message: str


@dataclass(frozen=True)
class Recording:
    """``motion`` has the columns t [s], TCP offset x, z [m], change of q_a1, q_a2 [rad]; ``torque`` t [s], u_m1, u_m2
    [N.m]. Both have single precision."""

    about: About
    motion: np.ndarray
    torque: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """TCP error [m] at the times of ``motion``."""
        return np.hypot(self.motion[:, 1], self.motion[:, 2])


def record(case: Case, roles: Sequence[str], trajectory: Trajectory) -> Recording:
    """The thinned recording of a simulated case; the trajectory holds the outputs ``q_a[1]`` and ``q_a[2]`` too."""
    scenario, ending = case.scenario, trajectory.ending
    offset = trajectory.X - trajectory.X[0]
    links = np.column_stack([trajectory.extra["q_a[1]"], trajectory.extra["q_a[2]"]])
    moved = np.column_stack([offset, links - links[0]])
    kept = thin(np.column_stack([offset, trajectory.tcp_error]), MOTION_INTERVALS)
    torque_kept = thin(trajectory.torque, TORQUE_INTERVALS)
    about = About(
        id=case.id,
        roles=tuple(roles),
        configuration=case.configuration.index,
        q_a=(case.configuration.q_a1, case.configuration.q_a2),
        system=case.system.name,
        test=case.test.name,
        duration=float(scenario.duration),
        force=scenario.pulse.force,
        window=(scenario.pulse.start, scenario.pulse.stop),
        chirp=(scenario.chirp.start, scenario.chirp.stop, scenario.chirp.f_start, scenario.chirp.f_stop),
        u_m0=trajectory.u_m0,
        status=ending.status.value,
        time=ending.time,
        message=ending.message,
    )
    return Recording(
        about,
        np.column_stack([trajectory.time[kept], moved[kept]]).astype(np.float32),
        np.column_stack([trajectory.time[torque_kept], trajectory.torque[torque_kept]]).astype(np.float32),
    )


def thin(signals: np.ndarray, intervals: int) -> np.ndarray:
    """Rows of ``signals`` (shape (N, signals)) to keep: of every interval and signal the smallest and the largest
    value, and the first and last row of all. Rows with a value that is not finite are left out."""
    rows = np.flatnonzero(np.isfinite(signals).all(axis=1))
    if rows.size <= 2 * intervals:
        return rows
    edges = np.linspace(0, rows.size, intervals + 1).astype(int)
    kept = {0, rows.size - 1}
    for begin, end in zip(edges[:-1], edges[1:], strict=True):
        part = signals[rows[begin:end]]
        kept.update((begin + np.argmin(part, axis=0)).tolist())
        kept.update((begin + np.argmax(part, axis=0)).tolist())
    return rows[sorted(kept)]


def save(recordings: Sequence[Recording], folder: Path) -> None:
    """Write the recordings of a run into its folder."""
    arrays = {"about": np.array(json.dumps([asdict(recording.about) for recording in recordings]))}
    for number, recording in enumerate(recordings):
        arrays[f"motion_{number}"] = recording.motion
        arrays[f"torque_{number}"] = recording.torque
    stream = io.BytesIO()
    np.savez_compressed(stream, allow_pickle=False, **arrays)
    write_bytes(folder / TRAJECTORIES, stream.getvalue())


def load(folder: Path) -> tuple[Recording, ...]:
    """The recordings of a run; none where it was made without. Raises :class:`InputError` for a damaged file."""
    file = folder / TRAJECTORIES
    try:
        content = file.read_bytes()
    except FileNotFoundError:
        return ()
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.") from problem
    try:
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            return tuple(
                Recording(_about(entry), stored[f"motion_{number}"], stored[f"torque_{number}"])
                for number, entry in enumerate(json.loads(str(stored["about"])))
            )
    except Exception as problem:  # NumPy, zipfile and zlib have all kinds for damaged files, in words for programmers
        raise InputError(
            f"{file} is damaged. Run the evaluation again, or delete it and do without trajectories."
        ) from problem


def _about(entry: dict[str, Any]) -> About:
    """Lists of JSON as the tuples they were."""
    values: dict[str, Any] = {name: tuple(value) if isinstance(value, list) else value for name, value in entry.items()}
    return About(**values)
