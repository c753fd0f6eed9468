"""Reading a recorded case: every number is checked before it is used, and nothing in the file can run."""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np

from .equations import Arm, arm
from .signals import RecordedScenario

SCHEMA = "flexible-manipulator-case/1"

STATES, STEPS = ("q_m", "q_a", "X", "noise"), ("given", "command", "torque")
"""Arrays with a row for each state, and for each step between two."""

DEFINITIONS = ("settling_error", "rest_window", "limit_cycle_window", "limit_cycle_directions")

COORDINATES = 2.0
"""Directions in which a limit cycle was measured before version 4 of the benchmark, whose files do not say it: x, z."""

MAX_DIRECTIONS = 1000

MAX_REPETITIONS = 1000

MAX_BYTES = 256 * 1024**2
"""Bytes that the arrays of a file may have together."""


READ_ERRORS = (KeyError, ValueError, TypeError, OverflowError, RecursionError, MemoryError)
"""What comes of contents that are no recorded case; an array may say that it has more numbers than there is memory."""


class Unreadable(Exception):
    """The file is no recorded case, in one sentence."""


@dataclass(frozen=True)
class Recorded:
    """A recorded case. ``arrays`` have shape (N + 1, 2) or (N, 2); ``claimed`` are the figures it is said to have come
    to, by the ``definitions`` [m, s]; the case itself ends at ``duration`` [s]."""

    id: str
    controller: str
    arm: Arm
    start: np.ndarray
    scenario: RecordedScenario
    duration: float
    arrays: Mapping[str, np.ndarray]
    definitions: Mapping[str, float]
    status: str
    claimed: Mapping[str, float]

    @property
    def samples(self) -> int:
        """Number of steps."""
        return len(self.arrays["command"])


def read(source: Path | bytes) -> Recorded:
    """The case in a file or in its bytes. Raises :class:`Unreadable`."""
    try:
        content = source if isinstance(source, bytes) else source.read_bytes()
        with zipfile.ZipFile(io.BytesIO(content)) as listed:
            # Before NumPy unpacks it: an .npz is a zip file, and may be a bomb.
            if sum(entry.file_size for entry in listed.infolist()) > MAX_BYTES:
                raise Unreadable("it is larger than a case can be")
        # A pickle in it could run anything.
        with np.load(io.BytesIO(content), allow_pickle=False) as file:
            about = json.loads(str(file["about"][()]))
            arrays = {name: np.asarray(file[name]) for name in (*STATES, *STEPS)}
        return _recorded(about, arrays)
    except Unreadable:
        raise
    except OSError as problem:
        raise Unreadable(problem.strerror or str(problem)) from None
    except (zipfile.BadZipFile, EOFError, *READ_ERRORS) as problem:
        raise Unreadable(f"it is no recorded case ({type(problem).__name__}: {str(problem)[:100]})") from None


def _recorded(about: Mapping[str, Any], arrays: Mapping[str, np.ndarray]) -> Recorded:
    if about["schema"] != SCHEMA:
        raise Unreadable(f"it has the schema {str(about['schema'])[:60]}, not {SCHEMA}")
    samples = len(arrays["command"])
    for name, array in arrays.items():
        shape = (samples + (name in STATES), 2)
        if array.shape != shape or array.dtype != np.float64 or not np.isfinite(array).all():
            raise Unreadable(f"its array {name} is not of {shape[0]} x 2 finite numbers")
    if samples == 0:
        raise Unreadable("it has no samples")
    parameters = _numbers(about["parameters"])
    return Recorded(
        id=str(about["id"])[:100],
        controller=str(about["controller"])[:100],
        arm=arm(parameters),
        start=np.array([parameters["q_a_start[1]"], parameters["q_a_start[2]"]]),
        scenario=_scenario(about["scenario"], parameters),
        duration=float(Fraction(about["scenario"]["duration"])),
        arrays=arrays,
        definitions=_definitions(about["definitions"]),
        status=str(about["status"])[:20],
        claimed=_numbers(about["claimed"]),
    )


def _definitions(given: Mapping[str, float]) -> dict[str, float]:
    numbers = {"limit_cycle_directions": COORDINATES, **_numbers(given)}
    if not COORDINATES <= numbers["limit_cycle_directions"] <= MAX_DIRECTIONS:
        raise Unreadable(f"its limit cycle is not measured in {COORDINATES:g} to {MAX_DIRECTIONS} directions")
    return {name: numbers[name] for name in DEFINITIONS}


def _numbers(given: Mapping[str, Any]) -> dict[str, float]:
    numbers = {str(name): float(value) for name, value in given.items()}
    if not all(map(math.isfinite, numbers.values())):
        raise Unreadable("a number is not finite")
    return numbers


def _scenario(given: Mapping[str, Any], parameters: Mapping[str, float]) -> RecordedScenario:
    for name, value in given["parameters"]:
        # Else the case could be simulated with one arm and checked with another.
        if parameters.get(name) != float(value):
            raise Unreadable(f"its scenario has another {name} than its parameters")
    interval = Fraction(given["sample_time"])
    sensor, drive, chirp, pulse = (given[name] for name in ("sensor", "drive", "chirp", "pulse"))
    scenario = RecordedScenario(
        sample_time=float(interval),
        sigma=float(sensor["noise"]["sigma"]),
        sensor_lag=_lags(sensor["delay"], interval),
        angle_quantum=float(sensor["quantum"]),
        gain=_pair(drive["gain"]),
        limit=_pair(drive["limit"]),
        torque_quantum=_pair(drive["quantum"]),
        drive_lag=_lags(drive["delay"], interval),
        chirp_amplitude=_pair(chirp["amplitude"]),
        chirp_times=(float(chirp["start"]), float(chirp["stop"])),
        chirp_frequencies=(float(chirp["f_start"]), float(chirp["f_stop"])),
        force=_pair(pulse["force"]),
        force_times=(float(pulse["start"]), float(pulse["stop"])),
        **_recurrence(given.get("again")),
    )
    if interval <= 0:
        raise Unreadable("its sample time is not positive")
    if float(drive.get("dropout", 0.0)) or Fraction(sensor.get("jitter", 0)):
        raise Unreadable("its samples are dropped or have jitter, which is not computed anew")
    return scenario


def _recurrence(given: Mapping[str, Any] | None) -> dict[str, Any]:
    """How often the disturbances come; files before this was told have them once."""
    if given is None:
        return {}
    number = int(given["number"])
    if not 1 <= number <= MAX_REPETITIONS or number != given["number"]:
        raise Unreadable(f"its disturbances do not come 1 to {MAX_REPETITIONS} times")
    return {"period": float(given["period"]), "number": number, "turn": float(given["turn"])}


def _pair(given: Any) -> tuple[float, float]:
    first, second = map(float, given)
    return first, second


def _lags(delays: Any, interval: Fraction) -> tuple[int, int]:
    """Delays in samples."""
    lags = [Fraction(delay) / interval for delay in delays]
    if any(lag.denominator != 1 or lag < 0 for lag in lags) or len(lags) != 2:
        raise Unreadable("a delay is no whole number of samples")
    return int(lags[0]), int(lags[1])
