"""Findings from running the controller, each in a process that may crash without harm."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..codec import Finite, Struct, pack, unpack
from ..errors import FmuError
from ..fmi.connectors import PLANT, bind
from ..fmi.lookup import find_values
from ..fmi.port import exchange
from ..fmi.slaves import Slave, load
from ..fmi.trace import CONTROLLER
from ..loop import behaviour
from ..loop.behaviour import ERROR, LATE, WORDS, CarryOver, ComputingTime, Convention
from ..loop.controller import Steady, prepared
from ..loop.master import steady_state
from ..loop.probe import answers
from ..loop.setup import Setup
from .finding import Finding, Severity

EXTRA_DELAY = (
    "An extra sample of delay costs stability margin; look for a unit delay or memory block at the output, or an "
    "export option that delays outputs by a step."
)
SEED = "Seed random numbers, initialize all memory, and read no clock: each evaluation gives other results."
_AGREE = "Nothing to do: every case begins at rest, where the conventions agree."

TIMING = {
    Convention.INITIALIZATION: (Severity.NOTE, _AGREE),
    Convention.TWICE: (Severity.NOTE, _AGREE),
    Convention.UNKNOWN: (
        Severity.NOTE,
        "A start-up phase, memory that begins with the first measurement, noise, or a law that depends on time does "
        "this. Nothing is wrong if that is intended.",
    ),
}
"""Severity and remedy of timing conventions other than a sample at the start of each step."""


class CheckTask(Struct):
    """A look of ``CHECKS``, by its number, and its conditions."""

    number: int
    setup: Setup
    sample_time: Fraction


class RestState(Struct):
    """The steady state that responses begin in: motor angles [rad], torques [N.m], link angles [rad]."""

    q_m: tuple[Finite, Finite]
    u_m: tuple[Finite, Finite]
    q_a: tuple[Finite, Finite]


def timing(
    responses: Sequence[np.ndarray], u_m0: tuple[float, float], torque_step: tuple[float, float]
) -> Iterator[Finding]:
    """Latency, timing convention, and the first output against ``u_m0`` [N.m], from the ``responses`` to EXPERIMENTS;
    ``torque_step`` [N.m] is that of the benchmark's quantizer per axis."""
    measured = behaviour.timing(responses)
    # Nothing else is worth a word then: each case would end with this.
    if not np.all(np.isfinite(measured.first_torque)):
        text = f"{measured.first_torque[0]:.4g}, {measured.first_torque[1]:.4g} N.m at rest"
        remedy = (
            "Look for a division by zero or memory without a start value: every case would end at its first sample."
        )
        yield Finding(Severity.ERROR, "initial output", text, remedy)
        return
    if measured.convention is Convention.SILENT:
        text = f"the controller {measured.convention.value} of {ERROR:g} rad at its inputs"
        remedy = (
            "Check that q_m is connected inside the model, that no input or parameter switches the controller off, "
        )
        remedy += "and that the output is not frozen."
        yield Finding(Severity.ERROR, "latency", text, remedy)
        return
    if measured.convention is Convention.RANDOM:
        yield Finding(
            Severity.WARNING, "latency", f"cannot be measured: the controller {measured.convention.value}", SEED
        )
    else:
        late = (Severity.WARNING, EXTRA_DELAY) if measured.latency else (Severity.OK, "")
        yield Finding(late[0], "latency", f"{measured.latency} samples from a measurement to the torque", late[1])
        severity, remedy = TIMING.get(measured.convention, (Severity.OK, ""))
        yield Finding(severity, "timing", measured.convention.value, remedy)
    difference = np.array(measured.first_torque) - np.array(u_m0)
    off = f"u_m0 {difference[0]:+.3g}, {difference[1]:+.3g} N.m at rest"
    # Below a step of the quantizer nothing of it reaches the plant.
    if np.all(np.abs(difference) < np.array(torque_step)):
        yield Finding(Severity.OK, "initial output", "u_m0 at rest" if not np.any(difference) else off)
    else:
        remedy = "Start the integrators with the input or parameter u_m0, which is mapped if it has another name; "
        remedy += "otherwise every run begins with a jump."
        text = f"{off}, more than a step of the torque's quantization"
        yield Finding(Severity.WARNING, "initial output", text, remedy)


def carry_over(shown: CarryOver) -> Iterator[Finding]:
    """What repeating a simulation in a fresh process has ``shown``, as an evaluation does it, too."""
    if shown is CarryOver.NONE:
        text = "a simulation gives equal torques after another one and in a fresh process"
        yield Finding(Severity.OK, "determinism", text)
    elif shown is CarryOver.DECLARED:
        remedy = "Nothing to mend: every simulation has a process of its own."
        yield Finding(Severity.NOTE, "instances", "only one per process, as declared", remedy)
    elif shown is CarryOver.FOUND:
        remedy = (
            "Keep all state in the instance and initialize it there. The benchmark runs every simulation in a process "
        )
        remedy += "of its own; masters that do not get other numbers."
        yield Finding(Severity.WARNING, "determinism", WORDS[shown], remedy)
    elif shown is CarryOver.RANDOM:
        yield Finding(Severity.WARNING, "determinism", WORDS[shown], SEED)


def reset(new: np.ndarray, again: np.ndarray) -> Iterator[Finding]:
    """An instance that has run and was reset must answer like a ``new`` one."""
    # To the last bit, as the benchmark itself is held to; what differs at all, differs more in a long run.
    if np.array_equal(new, again, equal_nan=True):
        yield Finding(Severity.OK, "reset", "a reset instance gives equal torques")
    else:
        text = f"a reset instance differs by up to {np.max(np.abs(new - again)):.3g} N.m"
        remedy = "The benchmark makes a new instance for every simulation, so this does no harm here."
        yield Finding(Severity.NOTE, "reset", text, remedy)


def several_instances(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """Two instances that exist at the same time must not affect each other."""
    steady = _steady(plant)
    # Not at rest, where an instance that does nothing would answer the same.
    alone = _response(controller, steady, task)
    other, step = load(controller.archive, CONTROLLER), float(task.sample_time)
    # Another reference: an instance that shares its state with the first one would answer to the wrong one.
    moved = replace(steady, q_m_ref=(steady.q_m_ref[0] + 1.0, steady.q_m_ref[1] - 1.0))
    with prepared(other, task.setup, moved, task.sample_time, 1.0) as port:
        beside = _response(controller, steady, task, lambda k: exchange(port, port.inputs.size, k * step, step, True))
    if np.array_equal(alone, beside, equal_nan=True):
        yield Finding(Severity.OK, "instances", "two at once do not disturb each other")
    else:
        remedy = "Keep state in the instance, not in global variables. The benchmark has one instance at a time."
        yield Finding(Severity.NOTE, "instances", "two at once disturb each other", remedy)


def cost(time: ComputingTime, sample_time: float, duration: float, timeout: float) -> Iterator[Finding]:
    """The time that one exchange takes: set, step, get; against the ``sample_time`` [s], and, over the ``duration`` [s]
    of a full simulation, against the ``timeout`` [s]."""
    spent = time.median
    text = f"{time.text} per step"
    full = spent * duration / sample_time
    if spent <= sample_time and full <= timeout:
        yield Finding(Severity.OK, "cost", text)
        return
    text += f"; the sample time is {sample_time * 1e6:g} µs, and {duration:g} s of simulation take {full:.0f} s"
    text += f", beyond the time limit of {timeout:g} s" if full > timeout else ""
    remedy = "It would not run in real time. Give the evaluation more time, or make the controller cheaper."
    yield Finding(Severity.WARNING, "cost", text, remedy)


def termination(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """The end of a simulation, after one step."""
    step = float(task.sample_time)
    with prepared(controller, task.setup, _steady(plant), task.sample_time, step) as port:
        exchange(port, port.inputs.size, 0.0, step, True)
        try:
            controller.terminate()
            yield Finding(Severity.OK, "termination", "the simulation can be ended")
        except FmuError as problem:
            remedy = (
                "Mend what the FMU reports. The results are not affected; every simulation will count this warning."
            )
            yield Finding(Severity.WARNING, "termination", str(problem), remedy)


Look = Callable[[Slave, Slave, CheckTask], Iterator[Finding]]
"""Yields its findings, given the loaded plant and controller."""


class Check(NamedTuple):
    """Something that is looked at; ``failure`` and ``loss`` are what it means if the look itself fails."""

    subject: str
    failure: Severity = Severity.ERROR
    loss: str = ""


_WITHOUT = "The benchmark does without: it"
TIMING_CHECK, COST_CHECK = Check("timing"), Check("cost")
RESET_CHECK = Check(
    "reset",
    Severity.WARNING,
    f"{_WITHOUT} makes a new instance for every simulation. Importers that reset will fail.",
)
CHECKS: tuple[tuple[Check, Look], ...] = (
    (
        Check(
            "several instances",
            Severity.WARNING,
            f"{_WITHOUT} has one instance at a time. Importers with several at once will fail.",
        ),
        several_instances,
    ),
    (Check("termination"), termination),
)
"""Those that take a process of the controller for themselves."""


def run_check(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """Findings of a :class:`CheckTask`: the work of a worker process."""
    unpacked = unpack(task, CheckTask)
    _, look = CHECKS[unpacked.number]
    return pack(tuple(look(plant, controller, unpacked)))


def find_rest(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """The :class:`RestState` of the plant, whatever the ``task``: the work of a worker process."""
    steady = _steady(plant)
    return pack(RestState(steady.q_m_ref, steady.u_m0, steady.q_a_ref))


def _steady(plant: Slave) -> Steady:
    """The steady state of the nominal plant in a bent pose, so that no torque is zero by chance."""
    description = plant.archive.description
    pose = find_values(description, {"q_a_start[1]": 0.3, "q_a_start[2]": -0.9}, "The plant")
    with plant.instantiated(1.0):
        plant.initialize(pose, {})
        return steady_state(plant, bind(description, PLANT, "The plant"))


def _response(
    controller: Slave, steady: Steady, task: CheckTask, between: Callable[[int], object] = lambda _: None
) -> np.ndarray:
    return answers(controller, task.setup, steady, task.sample_time, behaviour.step_errors(LATE), between=between)
