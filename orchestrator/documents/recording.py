"""The few trajectories a run keeps for its report: the samples that their curves bend at, stored beside the results.

A curve through the samples that are kept is nowhere farther from the others than the width of a line: it has every
peak, and no frequency that the signal does not have. Every point shown is one that was computed. Where a page has no
room for that, a torque has two curves, which are the bounds of what lies between them.
"""

from __future__ import annotations

import io
import math
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import IO, NamedTuple

import numpy as np

from ..benchmark.case import Case
from ..bounded import MAX_RESULT_BYTES, read
from ..codec import Finite, Malformed, NonNegative, Struct, from_json, to_json
from ..errors import InputError
from ..loop.scenario import Recurrence, later, turned
from ..loop.trajectory import Ending, Status, Trajectory
from .files import TRAJECTORIES, streamed, write_bytes

MOTION = ("t [s]", "x [m]", "z [m]", "q_a1 [rad]", "q_a2 [rad]")
TORQUE = ("t [s]", "u_m1 [N.m]", "u_m2 [N.m]")
"""Columns of a recording's two tables. The TCP's coordinates and the link angles are changes from the beginning."""

OBSERVED = ("q_a[1]", "q_a[2]")
"""Plant outputs that are recorded beside q_m and X."""

MOTION_SLACK = 3e-7
"""How far [m] a sample of the motion may be from the curve through those that are kept."""

TORQUE_SLACK = 1 / 200
"""The same of a torque, as a share of its limit: a pixel or two where the limits fit into a plot."""

EXACT, COARSE = 1e-3, 10.0
"""Factors on both: of the recording that figures for publication show, which has all samples but those on a straight
line, and of the systems that are drawn over each other, of which the errors alone are shown."""

MOST = 120_000
"""Rows of a table of one recording: all samples of 30 s."""

ROWS = 60_000
"""Rows of recordings together, of motion and of torque each, that keep a page below 5 MB."""

PEAKED, EVEN = 100, 1000
"""Intervals of a recording of which in any case the smallest and the largest sample are kept, and of which one is: a
chart that is zoomed leaves out what lies before the first point in sight."""

BOUNDED = 900
"""Intervals that the bounds of a torque are told of: no more than a plot has pixels, and longer than a period of what
is too lively to be drawn."""

BEFORE = 0.2
"""Time [s] before the force from which the force is shown."""

BLOCK = 64
"""Samples that are tried at once for being on a straight line."""

EXAMPLE, SYSTEMS = "example", "spread"
"""Roles beside the criteria (``B5``) and requirements (``A2 axis 2``): Figures 9-10, and 11-12 of the paper."""

BESIDE = "beside"
"""Role, before that of a worst case, of the nominal arm in the same pose and test."""

FOUND = "worst arm"
"""What stands for the system's name where a search has changed its parameters."""

Pair = tuple[Finite, Finite]


class Push(NamedTuple):
    """One coming of the disturbances: the force [N] and the time [s] it acts in; where the chirp before it begins; and
    until when its error is its own [s], which is the begin of the next one."""

    force: tuple[float, float]
    window: tuple[float, float]
    chirp: float
    until: float


class About(Struct, frozen=True, omit_defaults=True):
    """What was recorded. Angles and times in SI units; ``force`` [N], ``chirp`` start and stop [s] and start and stop
    frequency [Hz]; ``window`` [s] is when the force acts. Where disturbances come ``again``, these are the first ones.
    ``roles`` say what the recording is shown for."""

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
    again: Recurrence | None = None

    @property
    def pushes(self) -> tuple[Push, ...]:
        """All comings of the disturbances."""
        again = self.again or Recurrence()

        def times(time: float) -> list[float]:
            return [later(time, n, again.period) for n in range(again.number)]

        begins = times(min(self.chirp[0], self.window[0]))
        windows = zip(times(self.window[0]), times(self.window[1]), strict=True)
        forces = (turned(*self.force, n * again.turn) if n else self.force for n in range(again.number))
        ends = (*begins[1:], math.inf)
        return tuple(map(Push, forces, windows, times(self.chirp[0]), ends))


@dataclass(frozen=True)
class Recording:
    """``motion`` (shape (N, 5)) has the columns :data:`MOTION`, ``torque`` (shape (M, 3)) the columns :data:`TORQUE`.

    Both have single precision. On a page, ``torque`` may hold the smallest torques of an interval, and ``highest``
    (shape (M, 2)) the largest ones at the same times; where both are equal they are a sample.
    """

    about: About
    motion: np.ndarray
    torque: np.ndarray
    highest: np.ndarray | None = None

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

    def largest_torque(self, axis: int) -> float:
        """The largest torque of an axis [N.m], of either sign."""
        highest = self.torque[:, axis] if self.highest is None else self.highest[:, axis - 1]
        return float(np.abs([self.torque[:, axis], highest]).max(initial=0.0))


def record(case: Case, roles: Sequence[str], trajectory: Trajectory) -> Recording:
    """The recording of a simulated case, whose trajectory holds the outputs ``q_a[1]`` and ``q_a[2]`` too."""
    scenario, ending = case.scenario, trajectory.ending
    offset = trajectory.X - trajectory.X[0]
    links = np.column_stack([trajectory.extra["q_a[1]"], trajectory.extra["q_a[2]"]])
    moved = np.column_stack([offset, links - links[0]])
    # The largest error may be at neither coordinate's extremes: it is a signal of its own.
    tcp = np.column_stack([offset, trajectory.tcp_error])
    factor = EXACT if EXAMPLE in roles else COARSE if set(roles) == {SYSTEMS} else 1.0
    tops = np.abs(trajectory.torque).max(axis=0, initial=0.0)
    limits = [limit if math.isfinite(limit) else top for limit, top in zip(scenario.drive.limit, tops, strict=True)]
    kept = bent(trajectory.time, tcp, [factor * MOTION_SLACK] * 3, MOST)
    slack = [factor * TORQUE_SLACK * limit for limit in limits]
    torque_kept = bent(trajectory.time, trajectory.torque, slack, 0 if factor == COARSE else MOST)
    about = about_case(case, roles, trajectory.u_m0, ending)
    motion = np.column_stack([trajectory.time[kept], moved[kept]])
    torque = np.column_stack([trajectory.time[torque_kept], trajectory.torque[torque_kept]])
    return Recording(about, motion.astype(np.float32), torque.astype(np.float32))


def about_case(case: Case, roles: Sequence[str], u_m0: tuple[float, float], ending: Ending) -> About:
    """What is said of the recording of a ``case`` with this ``ending``, at the torques ``u_m0`` [N.m] at rest."""
    scenario = case.scenario
    return About(
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
        u_m0=u_m0,
        status=ending.status,
        time=ending.time,
        message=ending.message,
        again=scenario.again if scenario.again.number > 1 else None,
    )


def bent(time: np.ndarray, signals: np.ndarray, slack: Sequence[float], most: int) -> np.ndarray:
    """Rows of ``signals`` (shape (N, signals)) to keep, no more than ``most``: a curve through them is no farther from
    any signal than its ``slack``, which is doubled until they are few enough. Rows with a value that is not finite are
    left out."""
    rows = np.flatnonzero(np.isfinite(signals).all(axis=1))[: None if most else 0]
    t, finite, allowed = time[rows], signals[rows], np.asarray(slack)
    even = np.searchsorted(t, np.linspace(t[0], t[-1], min(EVEN, most // 4) + 1)) if t.size and most else rows[:0]
    # As flags: to sort the numbers of rows took longer than to find them.
    always = np.zeros(t.size, dtype=bool)
    always[extremes(finite, min(PEAKED, most // (4 * signals.shape[1] + 4)))] = always[even] = True
    most = max(most, int(np.count_nonzero(always)))
    blocks = _blocks(t, finite, allowed)
    kept = always | _bends(blocks, t.size, allowed)
    while np.count_nonzero(kept) > most and np.isfinite(allowed).all():
        allowed = np.maximum(2.0 * allowed, np.finfo(float).tiny)
        kept = always | _bends(blocks, t.size, allowed)
    found: np.ndarray = rows[kept]
    return found


class _Blocks(NamedTuple):
    """Blocks of one size: the row that each begins with, the ``parent`` whose half it is among those twice as large,
    and how far each signal leaves a straight line between the block's ends, of shape (signals, blocks)."""

    begins: np.ndarray
    parent: np.ndarray
    deviation: np.ndarray


def _blocks(t: np.ndarray, signals: np.ndarray, slack: np.ndarray) -> list[_Blocks]:
    """Blocks of BLOCK samples, and halves of those that a signal leaves by more than its ``slack``, to single steps."""
    last, size, found = t.size - 1, BLOCK, []
    begins = np.arange(0, last, size)
    parent = np.zeros(begins.size, dtype=int)
    while begins.size:
        ends = np.minimum(begins + size, last)
        # Two rows may have one time, in single precision.
        lengths = np.maximum(t[ends] - t[begins], np.finfo(float).tiny)[:, None]
        deviation = np.zeros((len(slack), begins.size))
        if size > 1:
            rows = np.minimum(begins[:, None] + np.arange(size), last)
            part = (t[rows] - t[begins, None]) / lengths
            for signal, away in zip(signals.T, deviation, strict=True):
                line = signal[begins, None] + part * (signal[ends] - signal[begins])[:, None]
                np.abs(signal[rows] - line).max(axis=1, out=away)
        found.append(_Blocks(begins, parent, deviation))
        size //= 2
        parent = np.flatnonzero((deviation > slack[:, None]).any(axis=0))
        parent = np.concatenate([parent, parent])
        begins = begins[parent] + np.repeat([0, size], parent.size // 2)
        begins, parent = begins[begins < last], parent[begins < last]
    return found


def _bends(blocks: Sequence[_Blocks], count: int, slack: np.ndarray) -> np.ndarray:
    """Which of ``count`` rows begin the largest blocks that no signal leaves by more than its ``slack``; and the
    last."""
    kept = np.zeros(count, dtype=bool)
    kept[-1:] = True
    halved = np.array([True])
    for size in blocks:
        straight = (size.deviation <= slack[:, None]).all(axis=0)
        tried = halved[size.parent]
        kept[size.begins[tried & straight]] = True
        halved = tried & ~straight
    return kept


def extremes(signals: np.ndarray, intervals: int) -> np.ndarray:
    """Rows of ``signals`` (shape (N, signals), all finite): of every interval and signal the smallest and the largest
    value, and the first and last row of all."""
    if signals.shape[0] <= 2 * intervals or not intervals:
        return np.arange(signals.shape[0] if intervals else 0)
    edges = np.linspace(0, signals.shape[0], intervals + 1).astype(int)
    begins, sizes = edges[:-1], np.diff(edges)
    place = np.arange(signals.shape[0])[:, None]
    kept = [np.array([0, signals.shape[0] - 1])]
    for extreme in (np.minimum, np.maximum):
        reached = signals == np.repeat(extreme.reduceat(signals, begins), sizes, axis=0)
        kept.append(np.minimum.reduceat(np.where(reached, place, signals.shape[0]), begins).ravel())
    rows: np.ndarray = np.unique(np.concatenate(kept))
    return rows


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


def shortened(entry: Recording, rows: int) -> Recording:
    """The recording with no more ``rows`` of motion, and of torque: of one with more, its bounds."""
    motion, torque, highest = entry.motion, entry.torque, entry.highest
    if len(motion) > rows:
        tcp = np.column_stack([motion[:, 1:3], entry.error])
        motion = motion[bent(motion[:, 0], tcp, [MOTION_SLACK] * 3, rows)]
    if len(torque) > rows:
        torque, highest = _bounds(entry, rows)
    return replace(entry, motion=motion, torque=torque, highest=highest)


def affordable(recordings: Sequence[Recording]) -> list[Recording]:
    """Recordings; if they are too many or too lively for a page, shortened alike."""
    room = ROWS
    short = []
    # What the shorter ones leave is shared by the others.
    for left, place in zip(range(len(recordings), 0, -1), _by_length(recordings), strict=True):
        entry = shortened(recordings[place], room // left)
        room -= max(len(entry.motion), len(entry.torque))
        short.append((place, entry))
    return [entry for _, entry in sorted(short, key=lambda pair: pair[0])]


def _by_length(recordings: Sequence[Recording]) -> list[int]:
    return sorted(range(len(recordings)), key=lambda place: len(recordings[place].torque))


def _bounds(entry: Recording, rows: int) -> tuple[np.ndarray, np.ndarray]:
    """The smallest torques of intervals, with the times, and the largest."""
    t, values = entry.torque[:, 0].astype(float), entry.torque[:, 1:]
    edges = np.linspace(t[0], t[-1], min(BOUNDED, rows // 3) + 1)
    times = np.union1d(t, edges)
    curves = np.column_stack([np.interp(times, t, value) for value in values.T])
    begins = np.searchsorted(times, edges)
    lowest, highest = (
        np.repeat(extreme(extreme.reduceat(curves, begins[:-1]), curves[begins[1:]]), 2, axis=0)
        for extreme in (np.minimum, np.maximum)
    )
    at = np.column_stack([edges[:-1], edges[1:]]).ravel()
    # From shortly before the force on, samples in the place of bounds, of as many intervals as there is room for.
    first = min(int(np.searchsorted(edges, entry.about.window[0] - BEFORE)), edges.size - 1)
    more = np.maximum.accumulate(begins - begins[first] - 2 * (np.arange(edges.size) - first))  # rows up to an edge
    end = max(int(np.searchsorted(more[first:], rows - at.size, side="right")) + first - 1, first)
    samples = slice(begins[first], begins[end] + 1 if end > first else begins[first])
    outside = np.concatenate([np.arange(2 * first), np.arange(2 * end, at.size)])
    joined, low, high = (
        np.insert(bounds[outside], 2 * first, shown[samples], axis=0).astype(np.float32)
        for bounds, shown in ((at, times), (lowest, curves), (highest, curves))
    )
    return np.column_stack([joined, low]), high


def save(recordings: Sequence[Recording], folder: Path) -> None:
    """Write the recordings of a run into its folder."""
    arrays = {
        "about": np.array(to_json([recording.about for recording in recordings], indent=None)),
        "columns_motion": np.array(MOTION),
        "columns_torque": np.array(TORQUE),
    }
    for number, recording in enumerate(recordings):
        # Column by column: 10 % smaller, as a number is like the one before it.
        arrays[f"motion_{number}"] = np.asfortranarray(recording.motion)
        arrays[f"torque_{number}"] = np.asfortranarray(recording.torque)
    write_bytes(folder / TRAJECTORIES, streamed(lambda file: _write_arrays(file, arrays)))


def _write_arrays(file: IO[bytes], arrays: Mapping[str, np.ndarray]) -> None:
    """As :func:`numpy.savez_compressed`, whose level of compression is fixed: it makes these files 1.6 % smaller than
    this level, in twice the time."""
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        for name, array in arrays.items():
            with archive.open(f"{name}.npy", "w", force_zip64=True) as entry:
                np.lib.format.write_array(entry, array, allow_pickle=False)


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
