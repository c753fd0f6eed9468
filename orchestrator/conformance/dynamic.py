"""Findings from running the controller, each in a process that may crash without harm."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np

from ..cosim.connectors import PLANT, bind
from ..cosim.controller import Setup, Steady, prepared
from ..cosim.lookup import find_parameters
from ..cosim.master import steady_state
from ..cosim.port import exchange, exchange_often
from ..cosim.probe import ERROR, LATE, Convention, probe, response
from ..cosim.slaves import Slave, load
from ..cosim.trace import CONTROLLER
from ..errors import FmuError
from .finding import Finding, Severity

TIMED_STEPS = 2000

_AGREE = "Nothing to mend: every case begins at rest, where the conventions agree."

TIMING = {
    Convention.INITIALIZATION: (Severity.NOTE, _AGREE),
    Convention.TWICE: (Severity.NOTE, _AGREE),
    Convention.UNKNOWN: (
        Severity.WARNING,
        "Look for noise, for laws that depend on time, and for a start-up phase, and switch them off to see the "
        "latency. The evaluation goes on.",
    ),
}
"""What a timing convention other than a sample at the start of each step is worth, and its remedy."""

TOLERANCE = 1e-6
"""Difference [N.m] between the first torque at rest and u_m0 that is worth a word."""


def timing(plant: Slave, controller: Slave, setup: Setup, sample_time: Fraction) -> Iterator[Finding]:
    """Latency, timing convention, and the first output against u_m0."""
    steady = _steady(plant)
    found = probe(controller, setup, steady, sample_time)
    if not np.all(np.isfinite(found.first_torque)):
        yield Finding(
            Severity.ERROR,
            "initial output",
            f"{found.first_torque[0]:.4g}, {found.first_torque[1]:.4g} N.m at rest",
            "Look for a division by zero or memory without a start value: every case would end at its first sample.",
        )
        return
    if found.convention is Convention.SILENT:
        yield Finding(
            Severity.ERROR,
            "latency",
            f"the controller {found.convention.value} of {ERROR:g} rad at its inputs",
            "Check that q_m is connected inside the model, and that the output is not frozen.",
        )
        return
    assert found.latency is not None
    severity = Severity.OK if found.latency == 0 else Severity.WARNING
    yield Finding(
        severity,
        "latency",
        f"{found.latency} samples from a measurement to the torque",
        ""
        if found.latency == 0
        else "An extra sample of delay costs stability margin; look for a unit delay or memory "
        "block at the output, or an export option that delays outputs by a step.",
    )
    severity, remedy = TIMING.get(found.convention, (Severity.OK, ""))
    yield Finding(severity, "timing", found.convention.value, remedy)
    difference = np.abs(np.array(found.first_torque) - np.array(steady.u_m0))
    if np.all(difference < TOLERANCE):
        yield Finding(Severity.OK, "initial output", "u_m0 at rest")
    else:
        yield Finding(
            Severity.WARNING,
            "initial output",
            f"{found.first_torque[0]:.4g}, {found.first_torque[1]:.4g} N.m at rest instead of u_m0 = "
            f"{steady.u_m0[0]:.4g}, {steady.u_m0[1]:.4g} N.m",
            "Start the integrators with the input or parameter u_m0; otherwise every run begins with a jump.",
        )


def repeatability(plant: Slave, controller: Slave, setup: Setup, sample_time: Fraction) -> Iterator[Finding]:
    """Two instances one after the other must answer alike."""
    steady = _steady(plant)
    first, second = (response(controller, setup, steady, sample_time, LATE) for _ in range(2))
    if np.array_equal(first, second, equal_nan=True):
        yield Finding(Severity.OK, "determinism", "two instances, one after the other, give equal torques")
    else:
        yield Finding(
            Severity.ERROR,
            "determinism",
            f"two instances, one after the other, differ by up to {np.max(np.abs(first - second)):.3g} N.m",
            "Seed random numbers, and initialize all memory: results would not be reproducible.",
        )


def reset(plant: Slave, controller: Slave, setup: Setup, sample_time: Fraction) -> Iterator[Finding]:
    """An instance that was initialized and reset must answer like a new one."""
    steady = _steady(plant)
    first = response(controller, setup, steady, sample_time, LATE)
    with controller.resetting():
        again = response(controller, setup, steady, sample_time, LATE)
    if np.array_equal(first, again, equal_nan=True):
        yield Finding(Severity.OK, "reset", "a reset instance gives equal torques")
    else:
        yield Finding(
            Severity.NOTE,
            "reset",
            f"a reset instance differs by up to {np.max(np.abs(first - again)):.3g} N.m",
            "The benchmark makes a new instance for every simulation, so this does no harm here.",
        )


def several_instances(plant: Slave, controller: Slave, setup: Setup, sample_time: Fraction) -> Iterator[Finding]:
    """Two instances alive at once must not disturb each other."""
    description = controller.archive.description
    interface = description.coSimulation or description.modelExchange
    if str(interface.canBeInstantiatedOnlyOncePerProcess).lower() in ("true", "1"):
        text, remedy = "only one per process, as declared", "Nothing to mend: the benchmark has one a process."
        yield Finding(Severity.NOTE, "instances", text, remedy)
        return
    steady = _steady(plant)
    alone = response(controller, setup, steady, sample_time, LATE)
    other = load(controller.archive, CONTROLLER)
    step = float(sample_time)
    moved = Steady((steady.q_m_ref[0] + 1.0, steady.q_m_ref[1] - 1.0), steady.u_m0, steady.q_a_ref)
    with prepared(other, setup, moved, sample_time, 1.0) as port:
        exchange(port, port.inputs.size, 0.0, step, True)
        beside = response(controller, setup, steady, sample_time, LATE)
        exchange(port, port.inputs.size, step, step, True)
    if np.array_equal(alone, beside, equal_nan=True):
        yield Finding(Severity.OK, "instances", "two at once do not disturb each other")
    else:
        yield Finding(
            Severity.NOTE,
            "instances",
            "two at once disturb each other",
            "Keep state in the instance, not in global variables. The benchmark has one controller a process.",
        )


def cost(plant: Slave, controller: Slave, setup: Setup, sample_time: Fraction) -> Iterator[Finding]:
    """Processor time of one exchange: set, step, get."""
    steady = _steady(plant)
    step = float(sample_time)
    with prepared(controller, setup, steady, sample_time, TIMED_STEPS * step) as port:
        port.input_values[:] = port.scale * (np.array(steady.q_m_ref) - port.offset)
        exchange_often(port, 0, 1, step)  # compiles, or loads what is compiled
        begin = time.perf_counter()
        exchange_often(port, 1, TIMED_STEPS - 1, step)
        spent = (time.perf_counter() - begin) / (TIMED_STEPS - 1)
    yield Finding(Severity.OK, "cost", f"{spent * 1e6:.2f} µs a step")


def termination(plant: Slave, controller: Slave, setup: Setup, sample_time: Fraction) -> Iterator[Finding]:
    """The end of a simulation, after one step."""
    step = float(sample_time)
    with prepared(controller, setup, _steady(plant), sample_time, step) as port:
        exchange(port, port.inputs.size, 0.0, step, True)
        try:
            controller.terminate()
        except FmuError as problem:
            yield Finding(
                Severity.WARNING,
                "termination",
                str(problem),
                "Mend what the FMU says itself. The results stand by then; every simulation will count this warning.",
            )
        else:
            yield Finding(Severity.OK, "termination", "the simulation can be ended")


Look = Callable[[Slave, Slave, Setup, Fraction], Iterator[Finding]]
"""Yields its findings, given the loaded plant and controller, the setup and the sample time."""


@dataclass(frozen=True)
class Check:
    """A look at the running controller; ``failure`` and ``loss`` are what it means where the look itself fails."""

    look: Look
    failure: Severity = Severity.ERROR
    loss: str = ""

    @property
    def subject(self) -> str:
        """What is looked at."""
        return self.look.__name__.replace("_", " ")


CHECKS = (
    Check(timing),
    Check(repeatability),
    Check(
        reset,
        Severity.WARNING,
        "The benchmark goes on without: it makes a new instance for every simulation. Importers that reset will fail.",
    ),
    Check(
        several_instances,
        Severity.WARNING,
        "The benchmark goes on without: it has one controller a process. Importers with several at once will fail.",
    ),
    Check(termination),
    Check(cost),
)


def run_check(plant: Slave, controller: Slave, task: tuple[int, Setup, Fraction]) -> list[Finding]:
    """Findings of one of ``CHECKS``, by its number: the work of a child process."""
    number, setup, sample_time = task
    return list(CHECKS[number].look(plant, controller, setup, sample_time))


def _steady(plant: Slave) -> Steady:
    """The steady state of the nominal plant in a bent pose, so that no torque is zero by chance."""
    description = plant.archive.description
    pose = find_parameters(description, {"q_a_start[1]": 0.3, "q_a_start[2]": -0.9}, "The plant")
    with plant.instantiated(1.0):
        plant.initialize(pose, {})
        return steady_state(plant, bind(description, PLANT, "The plant"))
