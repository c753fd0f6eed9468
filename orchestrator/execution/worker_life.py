"""What a worker's messages, and looks at it, come to: a state machine that starts no process, reads no clock and waits
for nothing."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from ..codec import Malformed
from ..errors import BenchmarkError, EnvironmentFault
from ..fmi.trace import CONTROLLER, Place
from .job import MANY_LOGGED, Died, Done, Job
from .messages import Failed, Finished, Garbage, Loaded, Message, error_of
from .process_tree import Use
from .standstill import Lookout, Standstill
from .time_limit import TimeSpent

START_TIMEOUT, FRESH_START_TIMEOUT = 10.0, 60.0
"""Seconds that a worker may take to load the FMUs, on top of its first task's limit: a forked one, and one that starts
from nothing and may have to compile."""

GARBAGE = "it wrote into a channel that is not its own"


@dataclass(frozen=True)
class Printed:
    """The worker has printed so many ``bytes``."""

    bytes: int


@dataclass(frozen=True)
class Received:
    """A ``message`` came, when the FMUs had ``logged`` so many messages in their simulation; or what is none."""

    message: Message | Garbage
    logged: int = 0


@dataclass(frozen=True)
class ProcessEnded:
    """The process has ended, or closed its channel: how, in ``words``; whether somebody else may have ended it."""

    words: str
    outside: bool


@dataclass(frozen=True)
class Looked:
    """A look at a ``time`` [s] of any steady clock: what the process uses, what the task has ``spent`` of its limit,
    the ``place`` of its simulation, and the process's ``end`` if there is one and nothing is left to be received."""

    time: float
    use: Use
    spent: TimeSpent
    place: Place
    end: ProcessEnded | None = None


Event = Printed | Received | ProcessEnded | Looked


@dataclass(frozen=True)
class Death:
    """The process ended or has to end: as in :class:`Died`, without what only the ended process shows."""

    message: str
    kind: str
    timeout: bool = False
    outside: bool = False


Answer = Done | Failed | Death | BenchmarkError | Standstill
"""The outcome of a task, the worker's death, an error to raise, or a standstill to tell."""


@dataclass(frozen=True)
class Life:
    """The ``task`` that a worker is at, whether the FMUs are ``loaded``, the bytes ``printed`` in the task, and where
    it was at the last look. Nothing happens any more when it is ``over``."""

    task: int = 0
    loaded: bool = False
    printed: int = 0
    lookout: Lookout = Lookout()
    over: bool = False

    def limits(self, job: Job) -> tuple[float, float]:
        """What may be spent [s] now, and at one place."""
        if self.loaded:
            return job.time_limits[self.task], job.longest_call
        fresh = job.sandbox and not job.isolated
        return job.time_limits[self.task] + (FRESH_START_TIMEOUT if fresh else START_TIMEOUT), math.inf


Step = tuple[Life, Answer | None]
"""What a life becomes by an event, and what this comes to."""


@dataclass(frozen=True)
class Remains:
    """What a dead worker leaves: the ``place`` of its simulation, its last ``lines``, the number of messages
    ``logged``, and the time ``elapsed`` [s] since its limit began."""

    place: Place
    lines: tuple[str, ...]
    logged: int
    elapsed: float


def on(life: Life, event: Event, job: Job) -> Step:
    """What ``event`` makes of the life of a worker that runs ``job``. After a death, a failure, an error or its last
    outcome it is over; the time limit begins anew when the FMUs are loaded, and with each task."""
    if life.over:
        return life, None
    match event:
        case Printed():
            life = replace(life, printed=life.printed + event.bytes)
            if life.printed > job.limits.output:
                told = f"it printed or logged more than {job.limits.output / 1e6:.0f} MB"
                return _dead(life, told, "it printed or logged too much")
            return life, None
        case Received():
            try:
                return _received(life, event, job)
            except (Garbage, Malformed) as problem:
                return _dead(life, f"{GARBAGE} ({problem})", GARBAGE)
        case ProcessEnded():
            return _dead(life, event.words, outside=event.outside)
        case Looked():
            return _looked(life, event, job)


def _dead(life: Life, message: str, kind: str = "", timeout: bool = False, outside: bool = False) -> Step:
    return replace(life, over=True), Death(message, kind or message, timeout, outside)


def _received(life: Life, event: Received, job: Job) -> Step:
    """Raises :class:`Garbage` or :class:`Malformed` for what this worker cannot have to say now."""
    message = event.message
    if isinstance(message, Garbage):
        raise message
    if isinstance(message, Loaded):
        if life.loaded:
            raise Garbage("it has loaded the FMUs twice")
        return replace(life, loaded=True, lookout=Lookout()), None
    # An FMU may write into the channel: a result before the FMUs are
    # loaded, or of another task, is a forged one.
    if message.index != life.task or (isinstance(message, Finished) and not life.loaded):
        raise Garbage("an outcome that is not due")
    if isinstance(message, Finished):
        done = Done(life.task, job.decode(life.task, message.value), message.wall_time, event.logged)
        task = life.task + 1
        return replace(life, task=task, printed=0, over=message.last or task == len(job.tasks)), done
    if message.error.kind == "environment":
        return replace(life, over=True), error_of(message.error)
    if message.error.kind == "crash":  # of the process of an isolated controller
        return _dead(life, message.error.message, outside=message.error.what == "killed")
    return replace(life, over=True), message


def _looked(life: Life, look: Looked, job: Job) -> Step:
    use, most, spent = look.use, job.limits, look.spent
    if use.memory > most.memory:
        told = f"it used {use.memory / 1e6:.0f} MB of memory; the limit is {most.memory / 1e6:.0f} MB"
        return _dead(life, told, "it used too much memory")
    if use.processes > most.processes:
        return _dead(life, f"it started more than {most.processes} processes")
    if use.threads > most.threads:
        return _dead(life, f"it started more than {most.threads} threads")
    limit, longest = life.limits(job)
    lookout = life.lookout.after(life.task, look.place, look.time, spent)
    for counted, allowed in ((spent, limit), (lookout.here(spent), longest)):
        told, kind = counted.excess(allowed)
        if told:
            # Somebody has stopped the process (SIGSTOP, a debugger): the time that passed is not the controller's.
            return _dead(life, told, kind, timeout=True, outside=spent.stopped)
    if look.end is not None:
        return _dead(life, look.end.words, outside=look.end.outside)
    standstill = lookout.standstill(look.time, spent, limit, longest)
    return replace(life, lookout=lookout if standstill is None else lookout.silent()), standstill


def died(life: Life, death: Death, remains: Remains) -> Died:
    """The outcome of the task that a worker died in.

    Raises :class:`EnvironmentFault` for a process that died before the controller can have anything to do with it.
    """
    message, place = death.message, remains.place
    if death.timeout and remains.logged > MANY_LOGGED:
        message += f"; it had logged {remains.logged} messages, which takes time"
    if not life.loaded and place.side != CONTROLLER:
        told = f"A simulation's process ended before it had loaded the FMUs: {message}"
        raise EnvironmentFault("\n  ".join((told, *remains.lines)), "worker-lost")
    return Died(life.task, death.timeout, message, death.kind, remains.elapsed, place, remains.lines, death.outside)
