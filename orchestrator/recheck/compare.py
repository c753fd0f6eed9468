"""A recorded case beside the same computed anew: the largest differences, each with its bound; and its figures, judged
anew from its recorded motion and torques."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from .equations import rest, tool
from .motion import SEGMENT, integrated
from .reading import Recorded, read
from .signals import RecordedScenario, chirp, delayed, force, limited, rounded, tied

Array = np.ndarray

START_BOUND = 1e-9
"""Of the angles at rest [rad]: both solve the same equation, up to rounding times the ratio of the gears."""

MAX_MEDIAN = {"motor angles": 1e-6, "link angles": 1e-8, "TCP": 1e-8}
"""Bounds of the median over the segments of 0.1 s, of the largest difference in each [rad, m]. A wrong parameter shows
in all segments. The plant's steps of fourth order have differences of some 1e-10 m while the arm is held, and larger
ones where motors turn around fast: in few segments, or, in a limit cycle, in all."""

METHOD_FACTOR = 2.0
"""So many times the median of what the plant's method itself is apart from DOP853 may be added to these."""

MAX_DIFFERENCE = {"motor angles": 5e-2, "link angles": 2e-4, "TCP": 1e-4, "motor speeds": 1.0, "link speeds": 3e-3}
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
    scenario, arrays, samples = case.scenario, case.arrays, case.samples
    q_m_ref, u_m0 = rest(case.arm, case.start)
    yield _row(
        "motor angles at rest", "rad", np.abs(arrays["q_m"][:1] - q_m_ref), START_BOUND * 200.0, scenario.sample_time
    )
    yield _row("link angles at rest", "rad", np.abs(arrays["q_a"][:1] - case.start), START_BOUND, scenario.sample_time)
    yield from _signals(case, q_m_ref, u_m0)
    driven = delayed(arrays["torque"], scenario.drive_lag, u_m0)
    u_d, pushed = chirp(scenario, samples), force(scenario, samples)
    motion = integrated(case.arm, scenario.sample_time, arrays["q_m"], arrays["q_a"], driven, u_d, pushed)
    method = motion.method
    moved = tool(case.arm, (motion.q_a + method[:, 2:]).T).T - tool(case.arm, motion.q_a.T).T
    for name, unit, difference, allowed in (
        ("motor angles", "rad", arrays["q_m"] - motion.q_m, method[:, :2]),
        ("link angles", "rad", arrays["q_a"] - motion.q_a, method[:, 2:]),
        ("TCP", "m", arrays["X"] - tool(case.arm, motion.q_a.T).T, moved),
    ):
        largest, slack = _by_segment(difference), METHOD_FACTOR * float(np.median(_by_segment(allowed)))
        yield Row(f"{name}, median of segments", unit, float(np.median(largest)), MAX_MEDIAN[name] + slack)
        yield _row(f"{name}, largest", unit, np.abs(difference), MAX_DIFFERENCE[name], scenario.sample_time)
        yield Row(f"{name}, the method's own", unit, float(np.abs(allowed).max()), MAX_DIFFERENCE[name])
    for name, unit, jumps in (("motor speeds", "rad/s", motion.jump_m), ("link speeds", "rad/s", motion.jump_a)):
        yield _row(
            f"{name} between segments, largest",
            unit,
            np.abs(jumps),
            MAX_DIFFERENCE[name],
            SEGMENT * scenario.sample_time,
        )
    yield from _figures(case, u_m0)


def _signals(case: Recorded, q_m_ref: Array, u_m0: Array) -> Iterator[Row]:
    """What the controller was given and what became of its torques: equal, but where the last bit decides."""
    scenario, arrays = case.scenario, case.arrays
    for i, axis in enumerate(("axis 1", "axis 2")):
        seen = delayed(arrays["q_m"] + arrays["noise"], scenario.sensor_lag, q_m_ref)[:-1, i]
        asked = limited(arrays["command"], u_m0, scenario)[:, i]
        for name, unit, values, quantum, recorded in (
            ("given angles", "rad", seen, scenario.angle_quantum, arrays["given"][:, i]),
            ("torques", "N.m", asked, scenario.torque_quantum[i], arrays["torque"][:, i]),
        ):
            difference = np.abs(rounded(values, quantum) - recorded)
            # Two programs that compute in another order may round a tie
            # to either side; no other difference is forgiven.
            difference[tied(values, quantum) & (difference <= 1.000001 * quantum)] = 0.0
            yield _row(f"{name}, {axis}", unit, difference, 1e-6 * quantum if quantum else 1e-9, scenario.sample_time)
    # The noise is taken from the file. That it is noise, and no help for the controller, shows in its size alone.
    spread = float(np.abs(arrays["noise"]).max())
    yield Row("noise, in standard deviations", "1", spread / scenario.sigma if scenario.sigma else spread, 8.0)


def _by_segment(difference: Array) -> Array:
    """The largest of each segment."""
    largest = np.abs(difference).max(axis=1)
    return np.array([largest[begin : begin + SEGMENT].max() for begin in range(1, len(largest), SEGMENT)])


def _figures(case: Recorded, u_m0: Array) -> Iterator[Row]:
    arrays = case.arrays
    judged = figures(case.scenario, case.duration, arrays["X"], arrays["torque"], u_m0, case.definitions)
    for name, value in case.claimed.items():
        figure = judged.get(name, math.inf)
        yield Row(name, "of itself", abs(figure - value) / max(abs(value), 1e-6), FIGURE_BOUND)
    if case.status == "done" and not case.claimed:
        yield Row("figures of a case that is done", "1", math.inf, 0.0)


def _row(name: str, unit: str, difference: Array, bound: float, interval: float) -> Row:
    worst = int(np.argmax(difference.max(axis=1) if difference.ndim > 1 else difference))
    return Row(name, unit, float(difference.max()), bound, worst * interval)


def figures(
    scenario: RecordedScenario, end: float, X: Array, torque: Array, u_m0: Array, definitions: Mapping[str, float]
) -> dict[str, float]:
    """B1 to B7 of the paper's Section 6, the largest TCP error at the end, the amplitude in the last window.

    ``X`` has shape (N + 1, 2) [m], ``torque`` (N, 2) [N.m]; ``end`` [s] is that of the case itself, which a simulation
    may go on beyond. Errors are distances from where the TCP began. Where the disturbances come again, B5 to B7 are the
    largest of all repetitions.
    """
    count = round(end / scenario.sample_time)
    t, error = np.arange(len(X)) * scenario.sample_time, np.hypot(*(X - X[0]).T)
    own_time = np.arange(len(X)) <= count
    judged = dict(zip(("B1", "B2"), np.abs(torque[:count] - u_m0).max(axis=0).tolist(), strict=True))
    judged |= dict(zip(("B3", "B4"), np.abs(torque[:count]).max(axis=0).tolist(), strict=True))
    rows = _by_repetition(scenario, t, error, own_time, definitions["settling_error"])
    judged |= dict(zip(("B5", "B6", "B7"), np.max(rows, axis=0).tolist(), strict=True))
    judged["rest_error"] = _largest(error[t >= t[-1] - definitions["rest_window"] - 1e-9])
    last = min(count, len(t) - 1)
    # Of the case itself, although a simulation in doubt goes on beyond its end.
    window = X[: last + 1][t[: last + 1] >= t[last] - definitions["limit_cycle_window"] - 1e-9]
    directions = int(definitions["limit_cycle_directions"])
    extents = (
        np.ptp((window - window[0]) @ [np.cos(angle), np.sin(angle)])
        for angle in np.pi * np.arange(directions) / directions
    )
    judged["limit_cycle_at_end"] = 0.5 * float(max(extents))
    return judged


def _by_repetition(
    scenario: RecordedScenario, t: Array, error: Array, own_time: Array, settled: float
) -> list[tuple[float, float, float]]:
    """B5, B6 and B7 of each repetition of the disturbances, which lasts until the next one begins."""
    begin = min(scenario.chirp_times[0], scenario.force_times[0])
    starts, pushes, releases = map(scenario.repeated, (scenario.chirp_times[0], *scenario.force_times))
    ends = [*scenario.repeated(begin)[1:], math.inf]
    end, found = t[own_time][-1], []
    for n, (start, pushed, released, until) in enumerate(zip(starts, pushes, releases, ends, strict=True)):
        inside = own_time & (t < until) & (t >= min(start, pushed))
        late = np.flatnonzero(inside & (t > released) & (error >= settled))
        # A force that the end cuts off has no time to settle.
        lasted = float(t[late[-1]] - released) if late.size and (n == 0 or released < end) else 0.0
        found.append((_largest(error[inside & (t >= pushed)]), lasted, _largest(error[inside & (t < pushed)])))
    return found


def _largest(values: Array) -> float:
    return float(values.max()) if values.size else 0.0
