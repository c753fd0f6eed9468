"""What worker processes do: functions of two loaded FMUs and a packed task, and the types of task and result.

The types are checked when they are unpacked, on both sides.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.case import Case, JudgedCase
from ..benchmark.doubt import with_latest_end
from ..benchmark.metrics import AT_THE_END, Measured, continuation_if_in_doubt, expected, judge, measure
from ..benchmark.protocol import JudgingTables, Protocol
from ..benchmark.results import Judgement
from ..codec import Finite, Malformed, Natural, Struct, pack, unpack
from ..documents.recording import OBSERVED, Recording, about_case, record
from ..errors import FmuError
from ..loop.scenario import Pair, Scenario
from ..loop.setup import Setup
from ..loop.trajectory import Ending, Status, Trajectory, blank

# Imports inside functions: a worker loads Numba and SciPy for the tasks that need them only.

if TYPE_CHECKING:  # it loads the compiler, which only workers need
    from ..fmi.slaves import Slave
    from ..loop.controller import Steady


BEGINNING = Fraction(2)
"""Simulated time [s] at the beginning of a case that is repeated: as long as the shortest case of the protocols."""


class CaseTask(Struct, frozen=True, tag=True):
    """Simulate a case and judge it by a protocol."""

    protocol: Protocol
    setup: Setup
    case: Case


class Simulated(Struct, frozen=True):
    """What a case came to, with its trajectory."""

    judgement: Judgement
    trajectory: Trajectory


class Digested(Struct, frozen=True):
    """What a case came to, with a ``digest`` of its signals."""

    judgement: Judgement
    digest: bytes


class RecordTask(Struct, frozen=True):
    """Simulate a case and keep what a report shows of it."""

    setup: Setup
    case: Case
    roles: tuple[str, ...]


class ScenarioTask(Struct, frozen=True, tag=True):
    """Simulate a scenario; ``observe`` names plant outputs to record."""

    setup: Setup
    scenario: Scenario
    observe: tuple[str, ...] = ()


class AnswerTask(Struct, frozen=True, tag=True):
    """What a controller answers at rest, in the steady state of motor angles [rad], torques [N.m] and link angles
    [rad], to each of the ``errors`` of shape (N, 2) [rad], with the ``initial_error`` [rad] during initialization.
    With ``after_reset``, they are those of an instance that has answered once and was reset."""

    setup: Setup
    q_m: Pair
    u_m: Pair
    q_a: Pair
    sample_time: Fraction
    errors: np.ndarray
    initial_error: Finite = 0.0
    after_reset: bool = False


class Beginning(Struct, frozen=True):
    """The steady state that a simulation begins in, as in :class:`AnswerTask`, and a ``digest`` of its signals."""

    q_m: tuple[Finite, Finite]
    u_m: tuple[Finite, Finite]
    q_a: tuple[Finite, Finite]
    digest: bytes


class TimingRecord(Struct, frozen=True):
    """The controller's latency in samples and its timing convention; None if they cannot be measured."""

    latency: Natural | None = None
    convention: str | None = None


def prepare() -> None:
    """Import and compile everything a simulation needs, so that no worker has to."""
    from ..benchmark import one_pass
    from ..fmi import symbols
    from ..loop.closed_loop import warm_up

    for module in ("orchestrator.loop.master", "fmpy.validation"):
        importlib.import_module(module)
    for task in (CaseTask, RecordTask, ScenarioTask):
        with contextlib.suppress(Malformed):
            unpack(b"", task)  # what its fields are is found out at the first time
    warm_up()
    one_pass.warm_up()
    symbols.of_the_program()


def judge_case(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`~orchestrator.benchmark.results.Judgement`."""
    return pack(_judged(plant, controller, unpack(packed, CaseTask)).judgement)


def simulate_case(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`Simulated`."""
    return pack(_judged(plant, controller, unpack(packed, CaseTask), OBSERVED))


def digest_case(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`Digested`."""
    simulated = _judged(plant, controller, unpack(packed, CaseTask))
    return pack(Digested(simulated.judgement, digest(simulated.trajectory)))


def begin_case(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`Digested` of its beginning. Of a :class:`ScenarioTask`, which repeats a
    beginning, it gives the digest alone."""
    task = unpack(packed, CaseTask | ScenarioTask)  # type: ignore[arg-type]  # a union of types
    if isinstance(task, ScenarioTask):
        return pack(digest_of_beginning(_simulate(plant, controller, task.scenario, task.setup), task.scenario))
    simulated = _judged(plant, controller, task)
    return pack(Digested(simulated.judgement, digest_of_beginning(simulated.trajectory, task.case.scenario)))


def digest(trajectory: Trajectory) -> bytes:
    """SHA-256 of a simulation's status, and of what its controller measured and commanded."""
    return _digest(trajectory.ending.status.value, trajectory.measured, trajectory.command)


def digest_of_beginning(trajectory: Trajectory, scenario: Scenario) -> bytes:
    """The same of what it measured and commanded in the :data:`BEGINNING`, however it went on."""
    samples = beginning(scenario).samples
    return _digest("", trajectory.measured[:samples], trajectory.command[:samples])


def _digest(text: str, *signals: np.ndarray) -> bytes:
    hashed = hashlib.sha256(text.encode())
    for signal in signals:
        hashed.update(signal.tobytes())
    return hashed.digest()


def beginning(scenario: Scenario) -> Scenario:
    """The :data:`BEGINNING` of ``scenario``. The FMUs are told the stop time of the whole one: by another one they
    could tell the two apart."""
    stop = max(scenario.samples * scenario.sample_time, scenario.stop_time)
    return replace(scenario, duration=min(scenario.duration, BEGINNING), stop_time=stop)


def record_case(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`RecordTask`; gives a :class:`~orchestrator.documents.recording.Recording`."""
    task = unpack(packed, RecordTask)
    trajectory = _simulate(plant, controller, task.case.scenario, task.setup, OBSERVED)
    return pack(record(task.case, task.roles, trajectory))


def simulate_scenario(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`ScenarioTask`; gives a :class:`~orchestrator.loop.trajectory.Trajectory`."""
    task = unpack(packed, ScenarioTask)
    return pack(_simulate(plant, controller, task.scenario, task.setup, task.observe))


def rehearse(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`Beginning` for a :class:`ScenarioTask`, torques as in :func:`answer` for an :class:`AnswerTask`; raises
    :class:`FmuError` if a call fails in the first sample."""
    task = unpack(packed, ScenarioTask | AnswerTask)  # type: ignore[arg-type]  # a union of types
    if isinstance(task, AnswerTask):
        return pack(_answers(controller, task))
    trajectory = _simulate(plant, controller, task.scenario, task.setup, OBSERVED)
    if trajectory.ending.status is Status.ERROR and trajectory.ending.failed_call and not len(trajectory.command):
        raise FmuError(f"The first sample fails: {trajectory.ending.message}", trajectory.ending.failed_call)
    q_a = (float(trajectory.extra["q_a[1]"][0]), float(trajectory.extra["q_a[2]"][0]))
    return pack(Beginning(trajectory.q_m_ref, trajectory.u_m0, q_a, digest(trajectory)))


def time_steps(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """A :class:`~orchestrator.loop.behaviour.ComputingTime`, over the beginning of a :class:`ScenarioTask`."""
    from ..loop.probe import computing_time

    task = unpack(packed, ScenarioTask)
    return pack(computing_time(plant, controller, task.setup, task.scenario))


def time_answers(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """The wall times [s] of the steps of an :class:`AnswerTask`, shape (N,)."""
    from ..loop.probe import step_times

    task = unpack(packed, AnswerTask)
    measured = np.array(task.q_m) - task.errors
    return pack(step_times(controller, task.setup, _steady(task), task.sample_time, measured))


def answer(plant: Slave, controller: Slave, packed: bytes) -> bytes:
    """An :class:`AnswerTask`; gives the torques [N.m], shape (N, 2)."""
    return pack(_answers(controller, unpack(packed, AnswerTask)))


def judged(protocol: Protocol, case: Case, value: bytes) -> Judgement:
    """What a worker sent for a :class:`CaseTask`, checked; raises :class:`~orchestrator.codec.Malformed`."""
    judgement = unpack(value, Judgement)
    _check(protocol, case, judgement)
    return judgement


def _check(protocol: Protocol, case: Case, judgement: Judgement) -> None:
    # The worker runs the controller: it could write into its channel that it was skipped, which counts for nothing.
    if judgement.status not in (Status.DONE, Status.UNSTABLE, Status.ERROR):
        raise Malformed(f"the status {judgement.status.value}, which only the supervision gives")
    check_judgement(protocol, case, judgement)


def check_judgement(protocol: JudgingTables, case: JudgedCase, judgement: Judgement) -> None:
    """Raise :class:`~orchestrator.codec.Malformed` for a judgement that ``case`` cannot have come to."""
    names, figures, end = judgement.measurements.names, expected(protocol, case), case.end
    early = figures - AT_THE_END if judgement.time > end else frozenset[str]()  # it failed after the case's own end
    possible = {Status.DONE: (figures,), Status.UNSTABLE: (figures, frozenset(), early)}
    if names not in possible.get(judgement.status, (frozenset(), early)):
        raise Malformed(f"the status {judgement.status.value} with the figures {', '.join(sorted(names)) or 'none'}")
    scenario = with_latest_end(protocol, case)
    latest = float(scenario.samples * scenario.sample_time)
    # A time beyond the end would enter the means of the tuning and the plots.
    if judgement.time > latest or (judgement.judged_until or 0.0) > latest:
        raise Malformed(f"a time of {judgement.time:g} s, beyond the end")


def largest_trajectory(scenario: Scenario) -> int:
    """Bytes that the trajectory of ``scenario`` has at most, packed."""
    shortest, longer = (len(pack(blank(samples, OBSERVED))) for samples in (0, 1))
    # Beside what grows with the samples there are the numbers of rows, and the words of the ending.
    return shortest + scenario.samples * (longer - shortest) + (1 << 16)


def recording(case: Case, roles: Sequence[str], value: bytes) -> Recording:
    """What a worker sent for a :class:`RecordTask`, checked."""
    sent = unpack(value, Recording)
    sent.check()
    # Of its own it has how it ended. One that told of 10^9 forces, for each of which a report has a place, filled the
    # memory of the process that wrote the report.
    told = sent.about
    if about_case(case, roles, told.u_m0, Ending(told.status, told.time, told.message)) != told:
        raise Malformed("a recording of another case")
    return sent


def simulated(protocol: Protocol, case: Case, value: bytes) -> Simulated:
    """What a worker sent for a :class:`CaseTask` with its trajectory, checked."""
    sent = unpack(value, Simulated)
    _check_trajectory(with_latest_end(protocol, case).samples, OBSERVED, sent.trajectory)
    _check(protocol, case, sent.judgement)
    return sent


def digested(protocol: Protocol, case: Case, value: bytes) -> Digested:
    """What a worker sent for a :class:`CaseTask` with a digest, checked."""
    sent = unpack(value, Digested)
    _check(protocol, case, sent.judgement)
    return sent


def begun(value: bytes) -> bytes:
    """The digest that a worker sent for the beginning of a case, checked."""
    digest = unpack(value, bytes)
    if len(digest) != hashlib.sha256().digest_size:
        raise Malformed("a digest of another size")
    return digest


def trajectory(samples: int, observe: tuple[str, ...], value: bytes) -> Trajectory:
    """What a worker sent for a :class:`ScenarioTask`, checked."""
    sent = unpack(value, Trajectory)
    _check_trajectory(samples, observe, sent)
    return sent


def answered(samples: int, value: bytes) -> np.ndarray:
    """The torques that a worker sent for an :class:`AnswerTask`, checked; shape (samples, 2) [N.m]."""
    torques = unpack(value, np.ndarray)
    if torques.shape != (samples, 2) or not np.isfinite(torques).all():
        raise Malformed("an answer of another size than asked for, or one that is not finite")
    return torques


def times(steps: int, value: bytes) -> np.ndarray:
    """The times that a worker sent for the ``steps`` of an :class:`AnswerTask`, checked; shape (steps,) [s]."""
    sent = unpack(value, np.ndarray)
    if sent.shape != (steps,) or not (np.isfinite(sent) & (sent >= 0.0)).all():
        raise Malformed("times of another number of steps, or none at all")
    return sent


def _check_trajectory(samples: int, observe: tuple[str, ...], trajectory: Trajectory) -> None:
    # What comes from a worker may be made by the controller in it; figures, reports and NumPy would fail far from here.
    if trajectory.time.ndim != 1 or not 1 <= len(trajectory.time) <= samples + 1:
        raise Malformed("a trajectory of another length than the scenario's")
    if trajectory.shapes != blank(len(trajectory.time) - 1, observe).shapes:
        raise Malformed("a trajectory of other sizes than the scenario's")
    if not (
        np.isfinite(trajectory.time).all()
        and np.isfinite((*trajectory.q_m_ref, *trajectory.u_m0, trajectory.ending.time)).all()
    ):
        raise Malformed("a time or a steady state that is not finite")
    if (np.diff(trajectory.time) < 0.0).any():
        raise Malformed("times that do not increase")


def _answers(controller: Slave, task: AnswerTask) -> np.ndarray:
    from ..loop.probe import answers

    return answers(
        controller,
        task.setup,
        _steady(task),
        task.sample_time,
        task.errors,
        task.initial_error,
        after_reset=task.after_reset,
    )


def _steady(task: AnswerTask) -> Steady:
    from ..loop.controller import Steady

    return Steady(task.q_m, task.u_m, task.q_a)


def _simulate(plant: Slave, controller: Slave, *arguments: Any, **options: Any) -> Trajectory:
    from ..loop.master import simulate

    return simulate(plant, controller, *arguments, **options)


def _judged(plant: Slave, controller: Slave, task: CaseTask, observe: tuple[str, ...] = ()) -> Simulated:
    """The case of a task, simulated until its end leaves no doubt. What is measured there is not measured again."""
    protocol: JudgingTables = task.protocol
    case: JudgedCase = task.case
    measured: Measured | None = None

    def look(trajectory: Trajectory) -> Scenario | None:
        nonlocal measured
        measured = measure(protocol, case, trajectory)
        later = continuation_if_in_doubt(protocol, case, measured)
        if later is not None:
            measured = None
        return later

    trajectory = _simulate(plant, controller, case.scenario, task.setup, observe, further=look)
    return Simulated(judge(protocol, case, trajectory, measured), trajectory)
