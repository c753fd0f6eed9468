"""Findings from running the controller, each in a process that may crash without harm."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from fractions import Fraction
from typing import NamedTuple

import numpy as np

from ..codec import Struct, pack, unpack
from ..errors import FmuError
from ..fmi.connectors import PLANT, bind
from ..fmi.lookup import find_values
from ..fmi.port import exchange
from ..fmi.slaves import Slave, load
from ..fmi.trace import CONTROLLER
from ..loop.controller import Steady, prepared
from ..loop.master import steady_state
from ..loop.probe import ERROR, LATE, Convention, probe, response
from ..loop.scenario import Scenario
from ..loop.setup import Setup
from ..loop.stopwatch import computing_time
from .finding import Finding, Severity

EXTRA_DELAY = (
    "An extra sample of delay costs stability margin; look for a unit delay or memory block at the output, or an "
    "export option that delays outputs by a step."
)
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
    """A look of ``CHECKS``, by its number, and its conditions: the ``torque_step`` [N.m] of the benchmark's quantizer
    per axis, a ``scenario`` to time steps in, the ``duration`` [s] of a full simulation, and the wall time it may take,
    ``timeout`` [s]."""

    number: int
    setup: Setup
    sample_time: Fraction
    torque_step: tuple[float, float]
    scenario: Scenario
    duration: float
    timeout: float


def timing(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """Latency, timing convention, and the first output against u_m0."""
    steady = _steady(plant)
    found = probe(controller, task.setup, steady, task.sample_time)
    if not np.all(np.isfinite(found.first_torque)):
        text = f"{found.first_torque[0]:.4g}, {found.first_torque[1]:.4g} N.m at rest"
        remedy = (
            "Look for a division by zero or memory without a start value: every case would end at its first sample."
        )
        yield Finding(Severity.ERROR, "initial output", text, remedy)
        return
    if found.convention is Convention.SILENT:
        text = f"the controller {found.convention.value} of {ERROR:g} rad at its inputs"
        remedy = "Check that q_m is connected inside the model, and that the output is not frozen."
        yield Finding(Severity.ERROR, "latency", text, remedy)
        return
    late = (Severity.WARNING, EXTRA_DELAY) if found.latency else (Severity.OK, "")
    yield Finding(late[0], "latency", f"{found.latency} samples from a measurement to the torque", late[1])
    severity, remedy = TIMING.get(found.convention, (Severity.OK, ""))
    yield Finding(severity, "timing", found.convention.value, remedy)
    difference = np.array(found.first_torque) - np.array(steady.u_m0)
    off = f"u_m0 {difference[0]:+.3g}, {difference[1]:+.3g} N.m at rest"
    if np.all(np.abs(difference) < np.array(task.torque_step)):
        yield Finding(Severity.OK, "initial output", "u_m0 at rest" if not np.any(difference) else off)
    else:
        remedy = "Start the integrators with the input or parameter u_m0; otherwise every run begins with a jump."
        text = f"{off}, more than a step of the torque's quantization"
        yield Finding(Severity.WARNING, "initial output", text, remedy)


def repeatability(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """Two instances one after the other must answer alike."""
    steady = _steady(plant)
    first, second = _response(controller, steady, task), _response(controller, steady, task)
    if np.array_equal(first, second, equal_nan=True):
        yield Finding(Severity.OK, "determinism", "two instances, one after the other, give equal torques")
    else:
        text = f"two instances, one after the other, differ by up to {np.max(np.abs(first - second)):.3g} N.m"
        remedy = "Seed random numbers, and initialize all memory: results would not be reproducible."
        yield Finding(Severity.ERROR, "determinism", text, remedy)


def reset(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """An instance that was initialized and reset must answer like a new one."""
    steady = _steady(plant)
    first = _response(controller, steady, task)
    with controller.resetting():
        again = _response(controller, steady, task)
    if np.array_equal(first, again, equal_nan=True):
        yield Finding(Severity.OK, "reset", "a reset instance gives equal torques")
    else:
        text = f"a reset instance differs by up to {np.max(np.abs(first - again)):.3g} N.m"
        remedy = "The benchmark makes a new instance for every simulation, so this does no harm here."
        yield Finding(Severity.NOTE, "reset", text, remedy)


def several_instances(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """Two instances that exist at the same time must not affect each other."""
    if str(controller.archive.interface.canBeInstantiatedOnlyOncePerProcess).lower() in ("true", "1"):
        text, remedy = "only one per process, as declared", "Nothing to mend: the benchmark uses one per process."
        yield Finding(Severity.NOTE, "instances", text, remedy)
        return
    steady = _steady(plant)
    alone = _response(controller, steady, task)
    other, step = load(controller.archive, CONTROLLER), float(task.sample_time)
    moved = replace(steady, q_m_ref=(steady.q_m_ref[0] + 1.0, steady.q_m_ref[1] - 1.0))
    with prepared(other, task.setup, moved, task.sample_time, 1.0) as port:
        exchange(port, port.inputs.size, 0.0, step, True)
        beside = _response(controller, steady, task)
        exchange(port, port.inputs.size, step, step, True)
    if np.array_equal(alone, beside, equal_nan=True):
        yield Finding(Severity.OK, "instances", "two at once do not disturb each other")
    else:
        remedy = "Keep state in the instance, not in global variables. The benchmark uses one controller per process."
        yield Finding(Severity.NOTE, "instances", "two at once disturb each other", remedy)


def cost(plant: Slave, controller: Slave, task: CheckTask) -> Iterator[Finding]:
    """The time that one exchange takes: set, step, get."""
    step, found = float(task.sample_time), computing_time(plant, controller, task.setup, task.scenario)
    spent = found.median
    text = f"{found.text} per step"
    full = spent * task.duration / step
    if spent <= step and full <= task.timeout:
        yield Finding(Severity.OK, "cost", text)
        return
    text += f"; the sample time is {step * 1e6:g} µs, and {task.duration:g} s of simulation take {full:.0f} s"
    text += f", beyond the time limit of {task.timeout:g} s" if full > task.timeout else ""
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
    """A look at the running controller; ``failure`` and ``loss`` are what it means if the look itself fails."""

    look: Look
    failure: Severity = Severity.ERROR
    loss: str = ""

    @property
    def subject(self) -> str:
        """What is looked at."""
        return self.look.__name__.replace("_", " ")


_WITHOUT = "The benchmark does without: it"
CHECKS = (
    Check(timing),
    Check(repeatability),
    Check(
        reset,
        Severity.WARNING,
        f"{_WITHOUT} makes a new instance for every simulation. Importers that reset will fail.",
    ),
    Check(
        several_instances,
        Severity.WARNING,
        f"{_WITHOUT} uses one controller per process. Importers with several at once will fail.",
    ),
    Check(termination),
    Check(cost),
)


def run_check(plant: Slave, controller: Slave, task: bytes) -> bytes:
    """Findings of a :class:`CheckTask`: the work of a worker process."""
    wanted = unpack(task, CheckTask)
    return pack(tuple(CHECKS[wanted.number].look(plant, controller, wanted)))


def _steady(plant: Slave) -> Steady:
    """The steady state of the nominal plant in a bent pose, so that no torque is zero by chance."""
    description = plant.archive.description
    pose = find_values(description, {"q_a_start[1]": 0.3, "q_a_start[2]": -0.9}, "The plant")
    with plant.instantiated(1.0):
        plant.initialize(pose, {})
        return steady_state(plant, bind(description, PLANT, "The plant"))


def _response(controller: Slave, steady: Steady, task: CheckTask) -> np.ndarray:
    return response(controller, task.setup, steady, task.sample_time, LATE)
