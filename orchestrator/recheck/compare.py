"""A recorded case beside the same computed anew: the largest differences, each with its bound."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .equations import rest, tool
from .figures import figures
from .motion import SEGMENT, integrated
from .reading import Recorded, read
from .signals import chirp, delayed, force, limited, rounded, tied

Array = np.ndarray

START_BOUND = 1e-9
"""Of the angles at rest [rad]: both solve the same equation, up to rounding times the ratio of the gears."""

USUAL = {"motor angles": 1e-6, "link angles": 1e-8, "TCP": 1e-8}
"""Bounds of the median over the segments of 0.1 s, of the largest difference in each [rad, m]. A wrong parameter shows
in all segments. The plant's steps of fourth order have differences of some 1e-10 m while the arm is held, and larger
ones where motors turn around fast: in few segments, or, in a limit cycle, in all."""

METHOD = 2.0
"""So many times the median of what the plant's method itself is apart from DOP853 may be added to these."""

MOST = {"motor angles": 5e-2, "link angles": 2e-4, "TCP": 1e-4, "motor speeds": 1.0, "link speeds": 3e-3}
"""Bounds of the largest difference of all: a disturbance at another time shows in one segment."""

FIGURE_BOUND = 1e-9
"""Of the figures: the same definitions on the same numbers."""


@dataclass(frozen=True)
class Row:
    """One comparison: the largest difference, at ``time`` [s] where it has one, and the bound that it has to keep."""

    name: str
    unit: str
    difference: float
    bound: float
    time: float | None = None

    @property
    def ok(self) -> bool:
        """Whether it is within its bound; a difference that is no number is not."""
        return self.difference <= self.bound


@dataclass(frozen=True)
class Recheck:
    """What the second checker finds in a case."""

    id: str
    controller: str
    rows: tuple[Row, ...]

    @property
    def ok(self) -> bool:
        """Whether all differences are within their bounds."""
        return all(row.ok for row in self.rows)

    def to_dict(self) -> dict[str, Any]:
        """As plain values."""
        return {**asdict(self), "ok": self.ok, "rows": [{**asdict(row), "ok": row.ok} for row in self.rows]}


def recheck(source: Path | bytes) -> Recheck:
    """Compute the case of a file, or of its bytes, anew. Raises :class:`.reading.Unreadable`."""
    case = read(source)
    return Recheck(case.id, case.controller, tuple(_rows(case)))


def _rows(case: Recorded) -> Iterator[Row]:
    own, arrays, samples = case.scenario, case.arrays, case.samples
    q_m_ref, u_m0 = rest(case.arm, case.start)
    yield _row("motor angles at rest", "rad", np.abs(arrays["q_m"][:1] - q_m_ref), START_BOUND * 200.0, own.sample_time)
    yield _row("link angles at rest", "rad", np.abs(arrays["q_a"][:1] - case.start), START_BOUND, own.sample_time)
    yield from _signals(case, q_m_ref, u_m0)
    driven = delayed(arrays["torque"], own.drive_lag, u_m0)
    u_d, pushed = chirp(own, samples), force(own, samples)
    found = integrated(case.arm, own.sample_time, arrays["q_m"], arrays["q_a"], driven, u_d, pushed)
    method = found.method
    moved = tool(case.arm, (found.q_a + method[:, 2:]).T).T - tool(case.arm, found.q_a.T).T
    for name, unit, difference, allowed in (
        ("motor angles", "rad", arrays["q_m"] - found.q_m, method[:, :2]),
        ("link angles", "rad", arrays["q_a"] - found.q_a, method[:, 2:]),
        ("TCP", "m", arrays["X"] - tool(case.arm, found.q_a.T).T, moved),
    ):
        each, slack = _by_segment(difference), METHOD * float(np.median(_by_segment(allowed)))
        yield Row(f"{name}, median of segments", unit, float(np.median(each)), USUAL[name] + slack)
        yield _row(f"{name}, largest", unit, np.abs(difference), MOST[name], own.sample_time)
        yield Row(f"{name}, the method's own", unit, float(np.abs(allowed).max()), MOST[name])
    for name, unit, jumps in (("motor speeds", "rad/s", found.jump_m), ("link speeds", "rad/s", found.jump_a)):
        yield _row(f"{name} between segments, largest", unit, np.abs(jumps), MOST[name], SEGMENT * own.sample_time)
    yield from _figures(case, u_m0)


def _signals(case: Recorded, q_m_ref: Array, u_m0: Array) -> Iterator[Row]:
    """What the controller was given and what became of its torques: equal, but where the last bit decides."""
    own, arrays = case.scenario, case.arrays
    for i, axis in enumerate(("axis 1", "axis 2")):
        seen = delayed(arrays["q_m"] + arrays["noise"], own.sensor_lag, q_m_ref)[:-1, i]
        asked = limited(arrays["command"], u_m0, own)[:, i]
        for name, unit, values, quantum, recorded in (
            ("given angles", "rad", seen, own.angle_quantum, arrays["given"][:, i]),
            ("torques", "N.m", asked, own.torque_quantum[i], arrays["torque"][:, i]),
        ):
            difference = np.abs(rounded(values, quantum) - recorded)
            difference[tied(values, quantum) & (difference <= 1.000001 * quantum)] = 0.0
            yield _row(f"{name}, {axis}", unit, difference, 1e-6 * quantum if quantum else 1e-9, own.sample_time)
    spread = float(np.abs(arrays["noise"]).max())
    yield Row("noise, in standard deviations", "1", spread / own.sigma if own.sigma else spread, 8.0)


def _by_segment(difference: Array) -> Array:
    """The largest of each segment."""
    largest = np.abs(difference).max(axis=1)
    return np.array([largest[begin : begin + SEGMENT].max() for begin in range(1, len(largest), SEGMENT)])


def _figures(case: Recorded, u_m0: Array) -> Iterator[Row]:
    arrays = case.arrays
    found = figures(case.scenario, case.duration, arrays["X"], arrays["torque"], u_m0, case.definitions)
    for name, value in case.claimed.items():
        own = found.get(name, math.inf)
        yield Row(name, "of itself", abs(own - value) / max(abs(value), 1e-6), FIGURE_BOUND)
    if case.status == "done" and not case.claimed:
        yield Row("figures of a case that is done", "1", math.inf, 0.0)


def _row(name: str, unit: str, difference: Array, bound: float, interval: float) -> Row:
    worst = int(np.argmax(difference.max(axis=1) if difference.ndim > 1 else difference))
    return Row(name, unit, float(difference.max()), bound, worst * interval)
