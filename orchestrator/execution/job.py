"""A job: tasks for one plant and one controller; and the outcomes of tasks."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any

import msgspec

from ..codec import NonNegative, Struct
from ..fmi.archive import Archive
from ..fmi.trace import Place
from .messages import Described, Failed, FmuFiles, Order
from .standstill import Standstill


@dataclass(frozen=True)
class Limits:
    """What a worker process may use with all that it starts: ``memory`` [bytes] resident, ``output`` [bytes] printed in
    one task, ``processes`` and ``threads`` alive at once.

    A user has a number of threads for all. Libraries that compute in parallel start one for each processor.
    """

    memory: int = 2 * 1024**3
    output: int = 16 * 1024**2
    processes: int = 256
    threads: int = 1024


@dataclass(frozen=True)
class Job:
    """A plant, a controller, and tasks for the two; one worker process runs the tasks in order, or one each.

    Parameters
    ----------
    work : str
        ``"module:function"``; ``function(plant, controller, task)`` gets the two loaded slaves and a packed task and
        returns a packed value.
    prepared_by : str
        The module that the process which workers are forked from imports, that of ``work`` if it is empty. If it has a
        function ``prepare()``, that is called there once. Jobs of one such module share the process.
    decode : callable
        ``decode(index, value)`` gives the value of a task from what a worker sent; raises
        :class:`~orchestrator.codec.Malformed` if that is not what the task can come to.
    largest : int
        Bytes that a value has at most.
    time_limits : tuple of float
        One per task [s]; see :mod:`~orchestrator.execution.time_limit` for what they limit.
    sandbox : bool
        Whether the process that loads the controller runs in a :mod:`~orchestrator.execution.sandbox`.
    isolated : bool
        Whether that is another one than the worker, a new one for each simulation.
    core : int
        The processor for both, -1 for any.
    give_up : bool
        Whether tasks after one that fails are left out.
    separate : bool
        Whether each task has a worker process of its own; those of an FMU that a process can instantiate only once have
        one in any case, so that such a task may instantiate each FMU once.
    longest_call : float
        The same [s] of what a simulation spends at one place, in one sample of the loop or in one call before it.
    on_standstill : callable
        ``on_standstill(index, standstill)`` is called once while the simulation of a task stands still, from the thread
        that looks after its process; on a cluster it is not.
    """

    plant: Archive
    controller: Archive
    work: str
    tasks: tuple[bytes, ...]
    time_limits: tuple[float, ...]
    decode: Callable[[int, bytes], Any]
    largest: int = 1 << 16
    limits: Limits = field(default_factory=Limits)
    sandbox: bool = False
    isolated: bool = False
    core: int = -1
    give_up: bool = False
    separate: bool = False
    longest_call: float = math.inf
    prepared_by: str = ""
    on_standstill: Callable[[int, Standstill], None] = lambda index, standstill: None

    def rest(self, first: int) -> Job:
        """What one process runs of the job, from task ``first`` on."""
        end = first + 1 if self.separate or is_once(self.plant, self.controller, self.isolated) else len(self.tasks)
        return replace(
            self,
            tasks=self.tasks[first:end],
            time_limits=self.time_limits[first:end],
            decode=lambda index, value: self.decode(first + index, value),
            on_standstill=lambda index, standstill: self.on_standstill(first + index, standstill),
        )

    def described(self) -> Described:
        """The two FMUs, of which a fork server reads the descriptions once for all workers."""
        both = (self.plant, self.controller)
        return Described(tuple(FmuFiles(fmu.name, fmu.sha256, str(fmu.folder), library=fmu.library) for fmu in both))

    def order(self, isolated: tuple[str, ...] = ()) -> Order:
        """What is sent to a worker; ``isolated`` is the command that starts a process for the controller."""
        plant, controller = self.described().fmus
        # The plant alone: a controller that ran before, with the user's rights,
        # could have replaced its files to be judged by another arm.
        plant = msgspec.structs.replace(plant, digests=self.plant.digests)
        return Order(plant, controller, self.work, self.tasks, isolated, self.core)


def is_once(plant: Archive, controller: Archive, isolated: bool = False) -> bool:
    """Whether a process of these two FMUs may run one task only; an ``isolated`` controller is in none of them."""
    return plant.once_per_process or (controller.once_per_process and not isolated)


MANY_LOGGED = 1_000_000
"""Messages in one simulation that take a noticeable time: ten in each of its samples."""


class Done(msgspec.Struct, frozen=True):
    """``value`` is the decoded result of task ``index``, ``wall_time`` [s] what it took, ``logged`` the number of
    messages that the FMUs logged in its last simulation. It is never sent."""

    index: int
    value: Any
    wall_time: NonNegative
    logged: int = 0


class Died(Struct, frozen=True, tag=True):
    """The process ended in task ``index`` at ``place`` in its simulation.

    ``timeout`` tells whether at a time limit, ``message`` how, ``kind`` the same without what was measured, so that
    equal failures have equal ones, and ``output`` holds the last lines that the process printed, and behind them the
    FMUs' own messages. ``outside`` tells whether somebody else may have ended the process, such as a system that is out
    of memory.
    """

    index: int
    timeout: bool
    message: str
    kind: str
    wall_time: NonNegative
    place: Place
    output: tuple[str, ...] = ()
    outside: bool = False


Outcome = Done | Failed | Died
