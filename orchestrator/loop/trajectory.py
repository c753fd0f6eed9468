"""What one simulation leaves behind."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any

import numpy as np

from .scenario import Pair


class Status(str, Enum):
    """How a simulation ended.

    All but the last two are the controller's. LOST was ended by something else, such as a system that is out of memory;
    SKIPPED was not run after failures. These two say nothing about the controller.
    """

    DONE = "done"
    UNSTABLE = "unstable"
    CRASHED = "crashed"
    TIMEOUT = "timeout"
    ERROR = "error"
    LOST = "lost"
    SKIPPED = "skipped"


@dataclass(frozen=True)
class Ending:
    """``status``, the simulated ``time`` [s] it came at, and for anything but DONE a sentence why (for DONE
    perhaps a warning).

    ``warnings`` counts FMI calls that returned a warning; ``failed_call`` names the one that returned worse.
    """

    status: Status
    time: float
    message: str = ""
    warnings: int = 0
    failed_call: str = ""


@dataclass(frozen=True)
class Trajectory:
    """Sampled signals of one simulation with N samples reached; times t_k = k T_s.

    ``time`` [s], ``q_m`` [rad], ``X`` [m] and ``extra`` (the other plant outputs asked for, by name) have N + 1 rows,
    the first one the initial state; ``measured`` [rad] is what the controller's delay line was fed with.
    ``given`` [rad], ``command`` and ``torque`` [N.m] have N rows: the angles that the controller was given, delayed and
    quantized, what it asked for, and what went to the drive (of a dropped sample, what went there before).
    ``q_m_ref`` [rad] and ``u_m0`` [N.m] are the plant's published steady state.
    """

    time: np.ndarray
    q_m: np.ndarray
    X: np.ndarray
    extra: dict[str, np.ndarray]
    measured: np.ndarray
    given: np.ndarray
    command: np.ndarray
    torque: np.ndarray
    q_m_ref: Pair
    u_m0: Pair
    ending: Ending

    @property
    def tcp_error(self) -> np.ndarray:
        """Distance of the TCP from where it began, shape (N + 1,) [m]."""
        offset = self.X - self.X[0]
        # Not np.hypot, whose last bit is the C library's. IEEE 754 fixes the square root.
        distance: np.ndarray = np.sqrt(offset[:, 0] * offset[:, 0] + offset[:, 1] * offset[:, 1])
        return distance

    @property
    def shapes(self) -> tuple[dict[str, tuple[int, ...]], ...]:
        """The shapes of its signals by name, and of those in ``extra``."""
        return _shapes(vars(self)), _shapes(self.extra)


def _shapes(values: Mapping[str, Any]) -> dict[str, tuple[int, ...]]:
    return {name: value.shape for name, value in values.items() if isinstance(value, np.ndarray)}


def blank(samples: int, observed: Sequence[str] = ()) -> Trajectory:
    """A trajectory of zeros with so many samples reached, and the outputs ``observed`` in ``extra``: all such have its
    sizes."""
    time, states, rows = (np.broadcast_to(0.0, shape) for shape in ((samples + 1,), (samples + 1, 2), (samples, 2)))
    return Trajectory(
        time=time,
        q_m=states,
        X=states,
        extra=dict.fromkeys(observed, time),
        measured=states,
        given=rows,
        command=rows,
        torque=rows,
        q_m_ref=(0.0, 0.0),
        u_m0=(0.0, 0.0),
        ending=Ending(Status.DONE, 0.0),
    )
