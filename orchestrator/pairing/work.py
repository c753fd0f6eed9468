"""What worker processes do: functions of two loaded FMUs and a packed task, and the types of task and result.

The types are checked when they are unpacked, on both sides.
"""

from __future__ import annotations

import contextlib
import hashlib
import importlib
from dataclasses import replace
from fractions import Fraction
from typing import TYPE_CHECKING, Any

import numpy as np

from ..benchmark.case import Case
from ..benchmark.doubt import longest
from ..benchmark.metrics import AT_THE_END, Measured, expected, further, judge, measure
from ..benchmark.protocol import Protocol
from ..benchmark.results import Judgement
from ..codec import Finite, Malformed, Natural, Struct, pack, unpack
from ..documents.recording import OBSERVED, Recording, record
from ..errors import FmuError
from ..loop.scenario import Pair, Scenario
from ..loop.setup import Setup
from ..loop.trajectory import Status, Trajectory

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
    from ..loop.warm_up import warm_up

    for module in ("orchestrator.loop.master", "fmpy.validation"):
        importlib.import_module(module)
    for task in (CaseTask, RecordTask, ScenarioTask):
        with contextlib.suppress(Malformed):
            unpack(b"", task)  # what its fields are is found out at the first time
    warm_up()
    one_pass.warm_up()


def judge_case(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`~orchestrator.benchmark.results.Judgement`."""
    return pack(_judged(plant, controller, unpack(task, CaseTask)).judgement)


def simulate_case(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`Simulated`."""
    return pack(_judged(plant, controller, unpack(task, CaseTask), OBSERVED))


def digest_case(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`Digested`."""
    found = _judged(plant, controller, unpack(task, CaseTask))
    return pack(Digested(found.judgement, digest(found.trajectory)))


def begin_case(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`CaseTask`; gives a :class:`Digested` of its beginning. Of a :class:`ScenarioTask`, which repeats a
    beginning, it gives the digest alone."""
    wanted = unpack(task, CaseTask | ScenarioTask)  # type: ignore[arg-type]  # a union of types
    if isinstance(wanted, ScenarioTask):
        return pack(digest_of_beginning(_simulate(plant, controller, wanted.scenario, wanted.setup), wanted.scenario))
    found = _judged(plant, controller, wanted)
    return pack(Digested(found.judgement, digest_of_beginning(found.trajectory, wanted.case.scenario)))


def digest(found: Trajectory) -> bytes:
    """SHA-256 of a simulation's status, and of what its controller measured and commanded."""
    return _digest(found.ending.status.value, found.measured, found.command)


def digest_of_beginning(found: Trajectory, scenario: Scenario) -> bytes:
    """The same of what it measured and commanded in the :data:`BEGINNING`, however it went on."""
    samples = beginning(scenario).samples
    return _digest("", found.measured[:samples], found.command[:samples])


def _digest(text: str, *signals: np.ndarray) -> bytes:
    found = hashlib.sha256(text.encode())
    for signal in signals:
        found.update(signal.tobytes())
    return found.digest()


def beginning(scenario: Scenario) -> Scenario:
    """The :data:`BEGINNING` of ``scenario``. The FMUs are told the stop time of the whole one: by another one they
    could tell the two apart."""
    stop = max(scenario.samples * scenario.sample_time, scenario.stop_time)
    return replace(scenario, duration=min(scenario.duration, BEGINNING), stop_time=stop)


def record_case(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`RecordTask`; gives a :class:`~orchestrator.documents.recording.Recording`."""
    wanted = unpack(task, RecordTask)
    trajectory = _simulate(plant, controller, wanted.case.scenario, wanted.setup, OBSERVED)
    return pack(record(wanted.case, wanted.roles, trajectory))


def simulate_scenario(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`ScenarioTask`; gives a :class:`~orchestrator.loop.trajectory.Trajectory`."""
    wanted = unpack(task, ScenarioTask)
    return pack(_simulate(plant, controller, wanted.scenario, wanted.setup, wanted.observe))


def rehearse(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`Beginning` for a :class:`ScenarioTask`, torques as in :func:`answer` for an :class:`AnswerTask`; raises
    :class:`FmuError` if a call fails in the first sample."""
    wanted = unpack(task, ScenarioTask | AnswerTask)  # type: ignore[arg-type]  # a union of types
    if isinstance(wanted, AnswerTask):
        return pack(_answers(controller, wanted))
    found = _simulate(plant, controller, wanted.scenario, wanted.setup, OBSERVED)
    if found.ending.status is Status.ERROR and found.ending.failed_call and not len(found.command):
        raise FmuError(f"The first sample fails: {found.ending.message}", found.ending.failed_call)
    q_a = (float(found.extra["q_a[1]"][0]), float(found.extra["q_a[2]"][0]))
    return pack(Beginning(found.q_m_ref, found.u_m0, q_a, digest(found)))


def time_steps(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """A :class:`~orchestrator.loop.stopwatch.ComputingTime`, over the beginning of a :class:`ScenarioTask`."""
    from ..loop.stopwatch import computing_time

    wanted = unpack(task, ScenarioTask)
    return pack(computing_time(plant, controller, wanted.setup, wanted.scenario))


def time_answers(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """The wall times [s] of the steps of an :class:`AnswerTask`, shape (N,)."""
    from ..loop.stopwatch import step_times

    wanted = unpack(task, AnswerTask)
    measured = np.array(wanted.q_m) - wanted.errors
    return pack(step_times(controller, wanted.setup, _steady(wanted), wanted.sample_time, measured))


def answer(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """An :class:`AnswerTask`; gives the torques [N.m], shape (N, 2)."""
    return pack(_answers(controller, unpack(task, AnswerTask)))


def judged(protocol: Protocol, case: Case, value: bytes) -> Judgement:
    """What a worker sent for a :class:`CaseTask`, checked; raises :class:`~orchestrator.codec.Malformed`."""
    found = unpack(value, Judgement)
    _check(protocol, case, found)
    return found


def _check(protocol: Protocol, case: Case, found: Judgement) -> None:
    if found.status not in (Status.DONE, Status.UNSTABLE, Status.ERROR):
        raise Malformed(f"the status {found.status.value}, which only the supervision gives")
    check_judgement(protocol, case, found)


def check_judgement(protocol: Protocol, case: Case, found: Judgement) -> None:
    """Raise :class:`~orchestrator.codec.Malformed` for a judgement that ``case`` cannot have come to."""
    names, wanted, end = found.measurements.names, expected(protocol, case), case.end
    early = wanted - AT_THE_END if found.time > end else frozenset[str]()  # it failed after the case's own end
    possible = {Status.DONE: (wanted,), Status.UNSTABLE: (wanted, frozenset(), early)}
    if names not in possible.get(found.status, (frozenset(), early)):
        raise Malformed(f"the status {found.status.value} with the figures {', '.join(sorted(names)) or 'none'}")
    scenario = longest(protocol, case)
    latest = float(scenario.samples * scenario.sample_time)
    if found.time > latest or (found.judged_until or 0.0) > latest:
        raise Malformed(f"a time of {found.time:g} s, beyond the end")


def largest_trajectory(scenario: Scenario) -> int:
    """Bytes that the trajectory of ``scenario`` has at most, packed."""
    pairs, scalars = 6, 1  # of a Trajectory: q_m, X, measured, given, command, torque; time
    columns = 2 * pairs + scalars + len(OBSERVED)
    return (scenario.samples + 2) * columns * 8 + (1 << 16)


def recording(value: bytes) -> Recording:
    """What a worker sent for a :class:`RecordTask`, checked."""
    found = unpack(value, Recording)
    found.check()
    return found


def simulated(protocol: Protocol, case: Case, value: bytes) -> Simulated:
    """What a worker sent for a :class:`CaseTask` with its trajectory, checked."""
    found = unpack(value, Simulated)
    _check_trajectory(longest(protocol, case).samples, OBSERVED, found.trajectory)
    _check(protocol, case, found.judgement)
    return found


def digested(protocol: Protocol, case: Case, value: bytes) -> Digested:
    """What a worker sent for a :class:`CaseTask` with a digest, checked."""
    found = unpack(value, Digested)
    _check(protocol, case, found.judgement)
    return found


def begun(value: bytes) -> bytes:
    """The digest that a worker sent for the beginning of a case, checked."""
    found = unpack(value, bytes)
    if len(found) != hashlib.sha256().digest_size:
        raise Malformed("a digest of another size")
    return found


def trajectory(samples: int, observe: tuple[str, ...], value: bytes) -> Trajectory:
    """What a worker sent for a :class:`ScenarioTask`, checked."""
    found = unpack(value, Trajectory)
    _check_trajectory(samples, observe, found)
    return found


def answered(samples: int, value: bytes) -> np.ndarray:
    """The torques that a worker sent for an :class:`AnswerTask`, checked; shape (samples, 2) [N.m]."""
    torques = unpack(value, np.ndarray)
    if torques.shape != (samples, 2) or not np.isfinite(torques).all():
        raise Malformed("an answer of another size than asked for, or one that is not finite")
    return torques


def times(steps: int, value: bytes) -> np.ndarray:
    """The times that a worker sent for the ``steps`` of an :class:`AnswerTask`, checked; shape (steps,) [s]."""
    found = unpack(value, np.ndarray)
    if found.shape != (steps,) or not (np.isfinite(found) & (found >= 0.0)).all():
        raise Malformed("times of another number of steps, or none at all")
    return found


def _check_trajectory(samples: int, observe: tuple[str, ...], found: Trajectory) -> None:
    if found.time.ndim != 1 or not 1 <= len(found.time) <= samples + 1:
        raise Malformed("a trajectory of another length than the scenario's")
    states = len(found.time)
    pairs = (found.q_m, found.X, found.measured, found.given, found.command, found.torque)
    shapes = [(states, 2)] * 3 + [(states - 1, 2)] * 3
    fits = set(found.extra) == set(observe) and [array.shape for array in pairs] == shapes
    if not fits or any(array.shape != (states,) for array in found.extra.values()):
        raise Malformed("a trajectory of other sizes than the scenario's")
    if not (np.isfinite(found.time).all() and np.isfinite((*found.q_m_ref, *found.u_m0, found.ending.time)).all()):
        raise Malformed("a time or a steady state that is not finite")
    if (np.diff(found.time) < 0.0).any():
        raise Malformed("times that do not increase")


def _answers(controller: Slave, wanted: AnswerTask) -> np.ndarray:
    from ..loop.probe import answers

    return answers(
        controller,
        wanted.setup,
        _steady(wanted),
        wanted.sample_time,
        wanted.errors,
        wanted.initial_error,
        after_reset=wanted.after_reset,
    )


def _steady(wanted: AnswerTask) -> Steady:
    from ..loop.controller import Steady

    return Steady(wanted.q_m, wanted.u_m, wanted.q_a)


def _simulate(plant: Slave, controller: Slave, *arguments: Any, **options: Any) -> Trajectory:
    from ..loop.master import simulate

    return simulate(plant, controller, *arguments, **options)


def _judged(plant: Slave, controller: Slave, wanted: CaseTask, observe: tuple[str, ...] = ()) -> Simulated:
    """The case of a task, simulated until its end leaves no doubt. What is measured there is not measured again."""
    protocol, case = wanted.protocol, wanted.case
    measured: Measured | None = None

    def look(trajectory: Trajectory) -> Scenario | None:
        nonlocal measured
        measured = measure(protocol, case, trajectory)
        later = further(protocol, case, measured)
        if later is not None:
            measured = None
        return later

    trajectory = _simulate(plant, controller, case.scenario, wanted.setup, observe, further=look)
    return Simulated(judge(protocol, case, trajectory, measured), trajectory)
