"""The few trajectories a run keeps for its report: thinned out, and stored beside the results.

A thinned signal keeps the smallest and the largest sample of every interval, at the times they were taken. So no peak
is lost and every point shown is one that was computed; what lies between two points is not.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..benchmark.case import Case
from ..bounded import MAX_RESULT_BYTES, read
from ..codec import Finite, Malformed, NonNegative, Struct, from_json, to_json
from ..errors import InputError
from ..loop.trajectory import Status, Trajectory
from .files import TRAJECTORIES, streamed, write_bytes

MOTION = ("t [s]", "x [m]", "z [m]", "q_a1 [rad]", "q_a2 [rad]")
TORQUE = ("t [s]", "u_m1 [N.m]", "u_m2 [N.m]")
"""Columns of a recording's two tables. The TCP's coordinates and the link angles are changes from the beginning."""

OBSERVED = ("q_a[1]", "q_a[2]")
"""Plant outputs that are recorded beside q_m and X."""

MOTION_INTERVALS = 1800
"""Intervals that the signals of the motion are thinned out to."""

ROWS = 75_000
"""Rows of recordings together, of motion and of torque each, that keep a page below 5 MB."""

EXAMPLE, SYSTEMS = "example", "spread"
"""Roles beside the criteria (``B5``) and requirements (``A2 axis 2``): Figures 9-10, and 11-12 of the paper."""

BESIDE = "beside"
"""Role, before that of a worst case, of the nominal arm in the same pose and test."""

FOUND = "worst arm"
"""What stands for the system's name where a search has changed its parameters."""

Pair = tuple[Finite, Finite]


class About(Struct, frozen=True):
    """What was recorded. Angles and times in SI units; ``force`` [N], ``chirp`` start and stop [s] and start and stop
    frequency [Hz]; ``window`` [s] is when the force acts. ``roles`` say what the recording is shown for."""

    id: str
    roles: tuple[str, ...]
    configuration: int
    q_a: Pair
    system: str
    test: str
    duration: NonNegative
    force: Pair
    window: Pair
    chirp: tuple[Finite, Finite, Finite, Finite]
    u_m0: Pair
    status: Status
    time: NonNegative
    message: str


@dataclass(frozen=True)
class Recording:
    """``motion`` (shape (N, 5)) has the columns :data:`MOTION`, ``torque`` (shape (M, 3)) the columns :data:`TORQUE`.

    Both have single precision.
    """

    about: About
    motion: np.ndarray
    torque: np.ndarray

    def check(self) -> None:
        """Raise :class:`~orchestrator.codec.Malformed` if the arrays are not what they should be."""
        for name, array, columns in (("motion", self.motion, MOTION), ("torque", self.torque, TORQUE)):
            if array.ndim != 2 or array.shape[1] != len(columns) or array.dtype != np.float32:
                raise Malformed(f"the recording {self.about.id} has a {name} of another form")
            if not np.isfinite(array).all() or (np.diff(array[:, 0]) < 0).any():
                raise Malformed(f"the recording {self.about.id} has a {name} that is not finite or not in order")

    @property
    def error(self) -> np.ndarray:
        """TCP error [m] at the times of ``motion``."""
        distance: np.ndarray = np.hypot(self.motion[:, 1], self.motion[:, 2])
        return distance


def record(
    case: Case, roles: Sequence[str], trajectory: Trajectory, motion_intervals: int = MOTION_INTERVALS
) -> Recording:
    """The thinned recording of a simulated case, its torques to half the intervals of its motion; the trajectory holds
    the outputs ``q_a[1]`` and ``q_a[2]`` too."""
    scenario, ending = case.scenario, trajectory.ending
    offset = trajectory.X - trajectory.X[0]
    links = np.column_stack([trajectory.extra["q_a[1]"], trajectory.extra["q_a[2]"]])
    moved = np.column_stack([offset, links - links[0]])
    # The largest error may be at neither coordinate's extremes: it is a signal of its own.
    kept = thin(np.column_stack([offset, trajectory.tcp_error]), motion_intervals)
    torque_kept = thin(trajectory.torque, motion_intervals // 2)
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
        status=ending.status,
        time=ending.time,
        message=ending.message,
    )
    motion = np.column_stack([trajectory.time[kept], moved[kept]])
    torque = np.column_stack([trajectory.time[torque_kept], trajectory.torque[torque_kept]])
    return Recording(about, motion.astype(np.float32), torque.astype(np.float32))


def thin(signals: np.ndarray, intervals: int) -> np.ndarray:
    """Rows of ``signals`` (shape (N, signals)) to keep: of every interval and signal the smallest and the largest
    value, and the first and last row of all. Rows with a value that is not finite are left out."""
    rows = np.flatnonzero(np.isfinite(signals).all(axis=1))
    if rows.size <= 2 * intervals:
        return rows
    edges = np.linspace(0, rows.size, intervals + 1).astype(int)
    begins, sizes, finite = edges[:-1], np.diff(edges), signals[rows]
    place = np.arange(rows.size)[:, None]
    kept = [np.array([0, rows.size - 1])]
    for extreme in (np.minimum, np.maximum):
        reached = finite == np.repeat(extreme.reduceat(finite, begins), sizes, axis=0)
        kept.append(np.minimum.reduceat(np.where(reached, place, rows.size), begins).ravel())
    thinned_rows: np.ndarray = rows[np.unique(np.concatenate(kept))]
    return thinned_rows


def peak(entry: Recording, begin: float = 0.0, end: float = math.inf) -> tuple[float, float] | None:
    """The largest TCP error [m] and its time [s] from ``begin`` to ``end``; None if nothing was recorded there."""
    inside = np.flatnonzero(within(entry, begin, end))
    if not inside.size:
        return None
    row = inside[np.argmax(entry.error[inside])]
    return float(entry.error[row]), float(entry.motion[row, 0])


def largest_error(entry: Recording, begin: float, end: float = math.inf) -> float | None:
    """The largest TCP error [m] alone."""
    largest = peak(entry, begin, end)
    return None if largest is None else largest[0]


def within(entry: Recording, begin: float, end: float) -> np.ndarray:
    """Which samples of ``motion`` were taken from ``begin`` to ``end`` [s]."""
    t = entry.motion[:, 0]
    return (t >= begin) & (t <= end)


def part_of(entry: Recording, begin: float, end: float) -> Recording:
    """The recording from ``begin`` to ``end`` [s]."""
    t = entry.torque[:, 0]
    motion, torque = entry.motion[within(entry, begin, end)], entry.torque[(t >= begin) & (t <= end)]
    return replace(entry, motion=motion, torque=torque)


def thinned(entry: Recording, intervals: int) -> Recording:
    """The recording with its error and its torques thinned out further."""
    motion, torque = entry.motion[thin(entry.error[:, None], intervals)], thin(entry.torque[:, 1:], intervals)
    return replace(entry, motion=motion, torque=entry.torque[torque])


def affordable(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings; if they are too many or too lively for a page, thinned out further, by the same signals as in
    :func:`record`."""
    tcp = [np.column_stack([entry.motion[:, 1:3], entry.error]) for entry in recordings]
    motions = _thinned([entry.motion for entry in recordings], tcp)
    torques = _thinned([entry.torque for entry in recordings], [entry.torque[:, 1:] for entry in recordings])
    both = zip(recordings, motions, torques, strict=True)
    return [replace(entry, motion=motion, torque=torque) for entry, motion, torque in both]


def _thinned(tables: Sequence[np.ndarray], signals: Sequence[np.ndarray]) -> list[np.ndarray]:
    """``tables`` with at most ``ROWS`` rows together, thinned out by ``signals``, each (N, signals), if need be."""
    if sum(map(len, tables)) <= ROWS:
        return list(tables)
    # An interval keeps two rows per signal, and a recording its first and last row.
    intervals = (ROWS // len(tables) - 2) // (2 * signals[0].shape[1])
    return [table[thin(values, intervals)] for table, values in zip(tables, signals, strict=True)]


def save(recordings: Sequence[Recording], folder: Path) -> None:
    """Write the recordings of a run into its folder."""
    arrays = {
        "about": np.array(to_json([recording.about for recording in recordings], indent=None)),
        "columns_motion": np.array(MOTION),
        "columns_torque": np.array(TORQUE),
    }
    for number, recording in enumerate(recordings):
        arrays[f"motion_{number}"] = recording.motion
        arrays[f"torque_{number}"] = recording.torque
    write_bytes(folder / TRAJECTORIES, streamed(lambda file: np.savez_compressed(file, allow_pickle=False, **arrays)))


def load(folder: Path) -> tuple[Recording, ...]:
    """The recordings of a run; none if it was made without. Raises :class:`InputError` for a damaged file."""
    file = folder / TRAJECTORIES
    try:
        content = read(file, MAX_RESULT_BYTES)
    except InputError as problem:
        if isinstance(problem.__cause__, FileNotFoundError):
            return ()
        raise
    try:
        # A file of kilobytes may unpack to gigabytes: its size on disk, which was bounded, says nothing of that.
        with zipfile.ZipFile(io.BytesIO(content)) as listed:
            if sum(entry.file_size for entry in listed.infolist()) > MAX_RESULT_BYTES:
                raise Malformed(f"it unpacks to more than {MAX_RESULT_BYTES / 1e6:.0f} MB")
        # Files may come from strangers, and a pickle runs code as it is read.
        with np.load(io.BytesIO(content), allow_pickle=False) as stored:
            if (tuple(stored["columns_motion"]), tuple(stored["columns_torque"])) != (MOTION, TORQUE):
                raise Malformed("its columns are not those of a recording")
            recordings = tuple(
                Recording(about, stored[f"motion_{number}"], stored[f"torque_{number}"])
                for number, about in enumerate(from_json(str(stored["about"]), tuple[About, ...]))
            )
        for recording in recordings:
            recording.check()
        return recordings
    except Malformed as problem:
        raise InputError(f"{file} is damaged: {problem}.", "damaged", file) from None
    except Exception as problem:  # NumPy, zipfile and zlib have all kinds for damaged files, in words for programmers
        raise InputError(f"{file} is damaged.", "damaged", file) from problem
