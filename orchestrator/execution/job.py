"""What crosses to a child process and what comes back."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from ..cosim.archive import Archive
from ..cosim.trace import Place


@dataclass(frozen=True)
class Limits:
    """What a child process may use: ``memory`` [bytes] resident, ``output`` [bytes] printed in one task."""

    memory: int = 2 * 1024**3
    output: int = 16 * 1024**2


@dataclass(frozen=True)
class Job:
    """A plant, a controller, and tasks for the two; one child process runs the tasks in order.

    ``work(plant, controller, task)`` gets the two loaded slaves and returns a picklable value; it must be a
    module-level function (or a partial of one), since it is sent to another process. ``time_limits`` are in seconds of
    wall time, one a task. With ``sandbox`` the child runs in a :mod:`~orchestrator.execution.sandbox`.
    """

    plant: Archive
    controller: Archive
    tasks: tuple[Any, ...]
    work: Callable[[Any, Any, Any], Any]
    time_limits: tuple[float, ...]
    limits: Limits = field(default_factory=Limits)
    sandbox: bool = False


@dataclass(frozen=True)
class Finished:
    """``value`` is what the work returned for task ``index``; ``wall_time`` [s] is what it took."""

    index: int
    value: Any
    wall_time: float


@dataclass(frozen=True)
class Failed:
    """Task ``index`` raised an error of the FMU's or the user's making: ``error``."""

    index: int
    error: Exception
    wall_time: float


@dataclass(frozen=True)
class Died:
    """The process ended in task ``index`` at ``place`` in its simulation.

    ``timeout`` tells whether at its time limit, ``message`` how, ``kind`` the same without what was measured, so that
    equal failures have equal ones, and ``output`` holds the last lines that the process printed, the FMUs' own messages
    among them. A ``kind`` that is empty is nothing to count.
    """

    index: int
    timeout: bool
    message: str
    kind: str
    wall_time: float
    place: Place
    output: tuple[str, ...] = ()
    outside: bool = False
    """Whether somebody else may have ended the process, such as a system that is out of memory."""


Outcome = Finished | Failed | Died
