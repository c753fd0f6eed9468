"""What the service keeps of people, runs and jobs, and what a job tells it. All of it is frozen; times are in seconds
since 1970.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Literal

from ..codec import Finite, Natural, Scalar, Struct


class State(str, Enum):
    """Where a run is; those of :data:`STAGES` name the stage that is next, or under way."""

    RECEIVED = "received"
    CHECKING = "checking"
    QUICK = "quick"
    EVALUATING = "evaluating"
    VERIFYING = "verifying"
    FINISHED = "finished"
    REFUSED = "refused"
    FAILED = "failed"
    CANCELLED = "cancelled"

    @property
    def is_final(self) -> bool:
        """Whether nothing more happens by itself."""
        return self in FINAL


FINAL = (State.FINISHED, State.REFUSED, State.FAILED, State.CANCELLED)

Stage = Literal["checking", "quick", "evaluating", "verifying"]

STAGES: tuple[Stage, ...] = ("checking", "quick", "evaluating", "verifying")
"""What is done with a run, one after the other, each in a process of its own. The last one is for the run that counts
for somebody in a round, and begins when that is closed."""

SHORT: frozenset[Stage] = frozenset({"checking", "quick"})
"""The stages that take seconds."""


@dataclass(frozen=True)
class Person:
    """Somebody who may use the service, under a ``name`` that others see. An ``organizer`` opens and closes rounds."""

    id: str
    name: str
    organizer: bool = False


@dataclass(frozen=True)
class Submission:
    """An FMU on its way.

    ``owner`` is the id of a person, ``sha256`` and ``size`` [bytes] are those of the FMU, ``name`` is what its owner
    calls it, and ``file_name`` what it is called in the run's folder. ``bound`` is the size [bytes] of its mapping
    file, 0 for none: :meth:`.Database.binding` has the text, with which lists of 200 runs took seconds to read.

    A stage that is under way is ``running``; ``attempts`` counts how often this one was lost to a fault of the machine,
    ``interruptions`` how often to an end of the service, and ``not_before`` is the time until when it waits.
    ``started`` is when a stage of it was last started, and ``finished`` when its evaluation ended. ``quick_cost`` and
    ``cost`` are V of the two evaluations, ``holds`` tells whether all requirements are met, ``remark`` what keeps the
    result from being ranked. ``disk`` is what its folder and the extracted FMU take [bytes], ``revision`` counts its
    changes.

    ``round`` is the id of the round in which it counts for its owner, from its close on. ``drawn_cost`` is then the
    mean of V over the draws, ``drawn_holds`` whether all requirements are met in them, ``drawn_remark`` what keeps it
    from a place, and ``deviations`` by what its certificate is not of the standard conditions.
    """

    id: str
    owner: str
    name: str
    file_name: str
    sha256: str
    size: int
    created: float
    state: State = State.RECEIVED
    running: bool = False
    attempts: int = 0
    interruptions: int = 0
    not_before: float = 0.0
    started: float = 0.0
    finished: float = 0.0
    reason: str = ""
    bound: int = 0
    verdict: str = ""
    quick_cost: float | None = None
    cost: float | None = None
    holds: bool | None = None
    remark: str = ""
    disk: int = 0
    revision: int = 0
    round: str = ""
    drawn_cost: float | None = None
    drawn_holds: bool | None = None
    drawn_remark: str = ""
    deviations: str = ""

    @property
    def is_evaluated(self) -> bool:
        """Whether its evaluation has ended; what counts in a round has been, whatever becomes of its verification."""
        return self.state is State.FINISHED or bool(self.round)

    @property
    def stage(self) -> Stage | None:
        """The stage that is next, or under way; None if there is none."""
        if self.state is State.RECEIVED:
            return STAGES[0]
        return next((stage for stage in STAGES if stage == self.state.value), None)


@dataclass(frozen=True)
class Round:
    """What people hand in between ``opened`` and ``closes``, or before an organizer has ``closed`` it.

    ``bits`` are what the draws of all verifications follow from, 64 hexadecimal digits; empty until the close, at which
    they are drawn.
    """

    id: str
    name: str
    opened: float
    closes: float
    closed: float | None = None
    bits: str = ""


@dataclass(frozen=True)
class HandIn:
    """Which ``run`` counts for its ``owner`` in a round. From the close on, the names of the ``person`` and of the run
    stay, also if the run is deleted."""

    owner: str
    run: str
    person: str = ""
    name: str = ""


@dataclass(frozen=True)
class Allowance:
    """What one person may have: ``queue`` runs that have not ended, ``runs`` at all, and ``disk`` [bytes] of them;
    ``upload`` is the largest FMU [bytes]; ``uploads``, ``forms`` and ``streams`` are uploads, other requests that bring
    something, and live pages at a time. ``patience`` [s] is how long a client may be silent, and ``upload_time`` [s]
    how long an upload may take."""

    queue: int = 20
    runs: int = 2000
    disk: int = 4 * 1024**3
    upload: int = 256 * 1024**2
    uploads: int = 4
    forms: int = 4
    streams: int = 12
    patience: float = 30.0
    upload_time: float = 900.0


@dataclass(frozen=True)
class Conduct:
    """How jobs are done: the names or files of both protocols and of that of a round's draws, ``processes`` of one job,
    ``sandbox``, the address of a Dask ``scheduler`` for evaluations (empty: this machine), how many ``evaluations`` run
    at a time, and the time [s] that a stage may take: an evaluation, a stage of seconds, for which others wait, and a
    verification, which takes some eleven times as long as an evaluation."""

    protocol: str = "paper"
    quick_protocol: str = "quick"
    drawn_protocol: str = "verification"
    processes: int = 1
    sandbox: bool = True
    scheduler: str = ""
    evaluations: int = 1
    stage_time: float = 6 * 3600.0
    short_time: float = 1200.0
    drawn_time: float = 72 * 3600.0

    def time(self, stage: Stage) -> float:
        """The time [s] that a stage may take."""
        if stage == "verifying":
            return self.drawn_time
        return min(self.stage_time, self.short_time) if stage in SHORT else self.stage_time

    @property
    def protocol_name(self) -> str:
        """The protocol for people, who need not know where its file is."""
        return Path(self.protocol).stem


@dataclass(frozen=True)
class Settings:
    """Of a whole service: whether people have ``accounts``, and what one sentence at the top warns of."""

    accounts: bool = False
    warning: str = ""
    limits: Allowance = field(default_factory=Allowance)
    conduct: Conduct = field(default_factory=Conduct)


class Task(Struct):
    """What a job is told: the ``stage``, the FMU and its mapping file (empty: none) in the folder that it is started
    in, and how to do it, as in :class:`Conduct`. By the FMU's ``sha256`` the job finds what it has extracted. ``bits``
    are those of a :class:`Round`, ``contents`` those of the protocol when the service was started (empty: any)."""

    stage: Stage
    file: str
    binding: str
    protocol: str
    processes: Natural
    sandbox: bool
    scheduler: str = ""
    sha256: str = ""
    bits: str = ""
    contents: str = ""


class Progress(Struct):
    """``done`` of ``total`` cases, V of what is complete so far, or one ``finding`` of a check."""

    done: Natural = 0
    total: Natural = 0
    cost: Finite | None = None
    finding: tuple[str, str, str] | None = None


class Outcome(Struct):
    """How a stage ended. A controller that cannot be used was ``"refused"``, one that failed has ``"failed"``, and what
    the machine could not do is a ``"fault"``; each with the ``reason``. ``lost`` tells of cases that the machine lost.

    ``verdict`` is the worst finding of a check; ``cost``, ``holds`` and ``remark`` are those of a run, or with
    ``deviations`` those over the draws; ``disk`` is what the run's folder takes [bytes].
    """

    stage: Stage
    kind: Literal["done", "refused", "failed", "fault"]
    reason: str = ""
    lost: bool = False
    verdict: str = ""
    cost: Finite | None = None
    holds: bool | None = None
    remark: str = ""
    deviations: str = ""
    disk: Natural = 0


class VariableRecord(Struct):
    """A variable of an FMU that may be bound or set; ``start`` is its start value as a user would type it."""

    name: str
    causality: str
    type: str
    unit: str
    size: Natural
    start: str = ""


class ConnectorRecord(Struct):
    """A connector, the variables that it could be bound to by causality and type (numbers in the list of all), and the
    names that it is ``bound`` to now: none, one array, or two."""

    name: str
    unit: str
    meaning: str
    required: bool
    causalities: tuple[str, ...]
    bound: tuple[str, ...] = ()
    found: str = ""


class Interface(Struct):
    """What the form for a binding is made of; ``left_out`` counts variables beyond those listed, ``given`` are the
    values of the mapping file that was used."""

    connectors: tuple[ConnectorRecord, ...]
    variables: tuple[VariableRecord, ...]
    left_out: Natural = 0
    given: dict[str, Scalar] = {}
