"""What is read off a trajectory: the criteria B1..B7, the limit cycle of A3, and whether the loop came to rest."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

import msgspec
import numpy as np

from ..loop.scenario import Repetition, Scenario
from ..loop.trajectory import Status, Trajectory
from .case import Case, JudgedCase
from .doubt import doubtful, falls, ratios, with_latest_end
from .protocol import JudgingTables, Stability
from .results import CaseResult, Judgement, Measurements, fields_of

# Imports inside functions: whoever only names the figures does without the compiler, which takes long to load.

if TYPE_CHECKING:
    from .one_pass import Places, Scan

OSCILLATION = (
    "limit_cycle",
    "limit_cycle_ratio",
    "limit_cycle_frequency",
    "limit_cycle_decay",
    "limit_cycle_at_end",
)
"""The figures of :func:`oscillation`."""

FIRST_AND_LATER = ("B6_first", "B6_later")
"""The figures of disturbances that come again."""

AT_THE_END = frozenset({"rest_error", *OSCILLATION})
"""The figures of the end of what was simulated; the others are those of the case's own time."""


VIBRATION_BEGIN, VIBRATION_END, VIBRATION_WINDOWS = 1.0, 8.0, 8
"""Times after the force [s] between which the residual vibration is measured, and the number of windows: a power of
two, whose geometric mean takes square roots alone. Their results are the same on every platform; those of a logarithm
are not."""


class Measured(NamedTuple):
    """The figures of a simulation, and by direction the amplitudes [m] in the last windows, none where no limit cycle
    is looked for."""

    measurements: Measurements
    curves: list[list[float]]


def continuation_if_in_doubt(protocol: JudgingTables, case: JudgedCase, measured: Measured) -> Scenario | None:
    """The scenario by which a case goes on that was ``measured`` at its own end; None if that leaves no doubt."""
    doubt = doubtful(protocol, case, measured.curves, measured.measurements.rest_error)
    return with_latest_end(protocol, case) if doubt else None


def judge(
    protocol: JudgingTables, case: JudgedCase, trajectory: Trajectory, measured: Measured | None = None
) -> Judgement:
    """Status and figures of a simulated case, whose trajectory may go on after the case's own end; ``measured`` if that
    was done before."""
    ending = trajectory.ending
    judgement = Judgement(status=ending.status, time=ending.time, message=ending.message, warnings=ending.warnings)
    if ending.status is not Status.DONE and ending.time <= case.end:
        return judgement
    measurements, _ = measured or measure(protocol, case, trajectory)
    limits = protocol.stability
    # The paper asks for stability; a loop that stands still beside its reference is none (A1, A2).
    if measurements.rest_error is not None and measurements.rest_error > limits.rest_error:
        reason = f"the TCP error was {measurements.rest_error * 1e3:.3g} mm in the last {limits.rest_window:g} s"
        judgement = msgspec.structs.replace(judgement, status=Status.UNSTABLE, message=reason)
    until = None if measurements.limit_cycle is None else float(trajectory.time[-1])
    return msgspec.structs.replace(judgement, measurements=measurements, judged_until=until)


def case_result(case: Case, judgement: Judgement) -> CaseResult:
    """A judgement with the names of its case."""
    return CaseResult(
        **fields_of(judgement),
        id=case.id,
        configuration=case.configuration,
        system=case.system.name,
        test=case.test.name,
    )


def expected(protocol: JudgingTables, case: JudgedCase) -> frozenset[str]:
    """Names of the figures that a simulation of ``case`` has when it reaches its end: those that its test asks for, as
    far as the scenario, which may have been varied, has what they are measured by."""
    scenario, limits, end = case.scenario, protocol.stability, case.end
    repetitions = scenario.repetitions
    pushed = 0.0 < scenario.pulse.stop < end
    shaken = scenario.chirp.start < min(scenario.chirp.stop, scenario.pulse.start) and scenario.pulse.start < end
    lacking = set() if pushed else {"B5", "B6"}
    names = {name for name in case.test.criteria if name not in lacking and (name != "B7" or shaken)}
    if "B6" in names:
        names.add("settled")
        names |= set(FIRST_AND_LATER) if len(repetitions) > 1 and repetitions[1].release < end else set()
    if case.test.requirements:
        names.add("rest_error")
        names |= {"recovery"} if pushed else set()
        names |= {"residual_vibration"} if pushed and repetitions[-1].release + VIBRATION_END <= end else set()
        names |= set(OSCILLATION) if 2.0 * limits.limit_cycle_window <= end else set()
    return frozenset(names)


def measure(protocol: JudgingTables, case: JudgedCase, trajectory: Trajectory) -> Measured:
    """What a simulation has shown that ran to the case's end, or on to a later one; of one that failed later, the
    figures of the case's own time."""
    names, time = expected(protocol, case), trajectory.time
    if trajectory.ending.status is not Status.DONE:
        names -= AT_THE_END
    parts = _scans(protocol, case, trajectory)
    torques = np.array([(*part.read.noise, *part.read.torque) for part in parts]).max(axis=0).tolist()
    values: dict[str, Any] = {
        **dict(zip(("B1", "B2", "B3", "B4"), torques, strict=True)),
        "B5": max(part.read.force_error for part in parts),
        "B7": max(part.read.chirp_error for part in parts),
        "rest_error": max(part.read.rest_error for part in parts),
    }
    # A force that is cut off by the end has no time to settle; of the first one alone it is not asked for then.
    released = [part for part in parts[1:] if part.repetition.release < case.end]
    settling = [_since_release(time, part, part.read.settling) for part in (parts[0], *released)]
    values["B6"], values["B6_first"] = max(settling), settling[0]
    values["B6_later"] = max(settling[1:], default=None)
    values["settled"] = all(part.read.settling < part.places.last for part in (parts[0], *released))
    values["recovery"] = max(_since_release(time, part, part.read.recovery) for part in (parts[0], *released))
    if "residual_vibration" in names:
        release = case.scenario.repetitions[-1].release
        values["residual_vibration"] = residual_vibration(time, trajectory.X, release)
    curves: list[list[float]] = []
    if OSCILLATION[0] in names:
        windows = _windows(protocol.stability, time)
        curves = _curves(trajectory.X, windows)
        values.update(
            zip(OSCILLATION, oscillation(protocol.stability, case, trajectory, windows[-1], curves), strict=True)
        )
    return Measured(Measurements(**{name: values[name] for name in names}), curves)


class Part(NamedTuple):
    """What was read of one repetition of the disturbances, and where."""

    repetition: Repetition
    places: Places
    read: Scan


def _since_release(time: np.ndarray, part: Part, last: int) -> float:
    """The time [s] from the end of a repetition's force until the sample ``last``; 0 if there is none, -1."""
    return 0.0 if last < 0 else float(time[last]) - part.repetition.release


def residual_vibration(time: np.ndarray, X: np.ndarray, release: float) -> float:
    """The geometric mean [m] of the TCP's amplitudes in the windows after the force has ended at ``release`` [s]; ``X``
    has the shape (samples, 2)."""
    from .one_pass import amplitudes

    edges = np.linspace(release + VIBRATION_BEGIN, release + VIBRATION_END, VIBRATION_WINDOWS + 1)
    places = np.searchsorted(time, edges).tolist()
    means = [float(amplitudes(X[begin:end]).max()) for begin, end in itertools.pairwise(places)]
    while len(means) > 1:
        means = [math.sqrt(first * second) for first, second in zip(means[::2], means[1::2], strict=True)]
    return means[0]


def _windows(limits: Stability, time: np.ndarray) -> list[int]:
    """The numbers of the first samples of the last windows, as many as fit into the simulation."""
    end = float(time[-1])
    fitting = [n for n in range(limits.limit_cycle_windows, 0, -1) if n * limits.limit_cycle_window <= end]
    begins: list[int] = np.searchsorted(time, [end - n * limits.limit_cycle_window for n in fitting]).tolist()
    return begins


def _curves(X: np.ndarray, windows: Sequence[int]) -> list[list[float]]:
    """By direction, the amplitude [m] in each of the windows with these first samples."""
    from .one_pass import amplitudes

    ends = (*windows[1:], len(X))
    by_window = [amplitudes(X[begin:end]) for begin, end in zip(windows, ends, strict=True)]
    curves: list[list[float]] = np.array(by_window).T.tolist()
    return curves


def _scans(protocol: JudgingTables, case: JudgedCase, trajectory: Trajectory) -> list[Part]:
    """What is read of each repetition of the disturbances that begins within the case; the last one goes on until the
    end of what was simulated."""
    from .one_pass import ALL, Places, scan

    time, scenario, limits = trajectory.time, case.scenario, protocol.stability
    errors = protocol.settling.error, limits.recovery_error
    repetitions = [each for each in scenario.repetitions if each.begin < case.end]
    begins, chirps, forces = np.searchsorted(time, np.array(repetitions)[:, :3].T).tolist()
    releases = np.searchsorted(time, [each.release for each in repetitions], side="right").tolist()
    rest = int(np.searchsorted(time, float(time[-1]) - limits.rest_window))
    rows = zip(repetitions, chirps, forces, releases, begins, (*begins[1:], ALL), strict=True)
    parts = []
    for repetition, chirp, force, release, first, until in rows:
        places = Places(scenario.samples + 1, chirp, force, release, rest, first, until)
        parts.append(Part(repetition, places, scan(trajectory.X, trajectory.torque, trajectory.u_m0, places, *errors)))
    return parts


def oscillation(
    limits: Stability, case: JudgedCase, trajectory: Trajectory, begin: int, curves: Sequence[Sequence[float]]
) -> tuple[float, float, float, float, float]:
    """The figures of :data:`OSCILLATION` from the ``curves``, by direction the amplitude [m] in each of the last
    windows, the last of which has ``begin`` as its first sample; without detrending.

    The amplitude of a direction is that of the last window; after a longer simulation than the case's own, in which a
    motion goes on until the last window and does not fall in each, the largest of all windows, and of the last one of
    the case's own if the motion did not fall in each of those, either. The first figure is the largest of these. Of its
    direction, or of the one in which the motion does not die away: the ratio to the window before, the strongest
    frequency [Hz], and the largest ratio of any two successive windows. Last, the largest amplitude at the case's own
    end.
    """
    from .one_pass import COSINES, SINES

    samples, X, time = case.scenario.samples + 1, trajectory.X, trajectory.time
    last, own_curves = [curve[-1] for curve in curves], curves
    if time.size > samples:
        own_curves = _curves(X[:samples], _windows(limits, time[:samples]))
        last = [_lasting(limits, *both) for both in zip(curves, own_curves, strict=True)]

    def severity(direction: int) -> tuple[bool, float]:
        slow = max(ratios(curves[direction]), default=1.0) >= limits.ring_down
        # A smaller motion that stays is worse than a larger one that dies away.
        return slow and last[direction] >= limits.limit_cycle, last[direction]

    worst = max(range(len(curves)), key=severity)
    shares = ratios(curves[worst])
    curve = COSINES[worst] * X[begin:, 0] + SINES[worst] * X[begin:, 1]
    # Without the mean, which would be the strongest of all.
    strongest = int(np.argmax(np.abs(np.fft.rfft(curve - curve.mean()))))
    frequency = strongest / (curve.size * float(time[1] - time[0]))
    return max(last), shares[-1], frequency, max(shares), max(curve[-1] for curve in own_curves)


def _lasting(limits: Stability, amplitudes: Sequence[float], before: Sequence[float]) -> float:
    """The amplitude [m] of a motion in one direction by its last windows and those of the case's own end ``before``."""
    if amplitudes[-1] < limits.doubtful or falls(amplitudes):
        return amplitudes[-1]
    # A limit cycle that begins late, or swells and shrinks, is as large as it ever was, not as in the last window. What
    # has died out since the case's own end was none.
    return max(*amplitudes, 0.0 if falls(before) else before[-1])
