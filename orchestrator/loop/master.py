"""The master: two slaves and a scenario in, a trajectory out."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from ..errors import Crash, FmuError
from ..fmi import port, trace
from ..fmi.connectors import PLANT, Binding, bind
from ..fmi.lookup import find_outputs, find_values
from ..fmi.slaves import Slave
from ..jit import arithmetic_now, arithmetic_words
from . import closed_loop as loop
from . import random_streams
from .controller import Remote, Steady, prepared
from .scenario import CELLS, Scenario, chirp_signal, make_plan, pulse_signal
from .setup import Setup
from .trajectory import Ending, Status, Trajectory

MAX_MOTOR_ANGLE = 1e9
"""A motor angle [rad] that limited torques cannot cause in any simulation: the plant itself has failed."""

STATUS_WORDS = ("ok", "warning", "discard", "error", "fatal", "pending")

STEPPING_WORDS = {
    port.TERMINATED: "ended the simulation",
    port.EARLY_RETURN: "stopped before the end of the step",
    port.EVENT_MODE: "waits for event mode, which it was told that the master does not use",
    port.ENDLESS_EVENTS: "asks for event iterations without end",
}


def simulate(
    plant: Slave,
    controller: Slave | Remote,
    scenario: Scenario,
    setup: Setup | None = None,
    observe: Sequence[str] = (),
    watch: Callable[[loop.SampleArrays], None] | None = None,
    further: Callable[[Trajectory], Scenario | None] = lambda _: None,
) -> Trajectory:
    """Simulate the closed loop of ``scenario``.

    The plant is initialized first; the steady state it publishes, q_m_ref and u_m0, is what the controller is
    initialized with. ``observe`` names further plant outputs to record; ``watch`` is given the arrays that the loop is
    about to fill. A simulation that comes to its end goes on if ``further`` gives a scenario for its trajectory, the
    same one with a later end.

    Raises :class:`~orchestrator.errors.FmuError` if an FMU fails before the first sample,
    :class:`~orchestrator.errors.InputError` if a name is unknown; the trajectory's ending holds what happens later,
    except that the process of a ``controller`` in another one ends, which is a :class:`~orchestrator.errors.Crash`.
    """
    what = f"The plant {plant.archive.name}"
    binding = bind(plant.archive.description, PLANT, what)
    driven = [variable for name in ("u_m", "u_d", "F") for variable in binding[name].variables]
    parameters = find_values(plant.archive.description, dict(scenario.parameters), what, driven)
    observed = find_outputs(plant.archive.description, observe, what)
    outputs = [variable for name in ("q_m", "X") for variable in binding[name].variables] + observed
    # Before the first call: a crash in it must not be told at the place of the simulation before.
    trace.current.reset()

    # FMUs are told a stop time that is the same for all cases: it must not tell a controller which test it is in.
    with plant.instantiated(scenario.announced):
        plant.initialize(parameters, {})
        steady = steady_state(plant, binding)
        with prepared(
            controller, setup or Setup(), steady, scenario.sample_time, scenario.announced
        ) as controller_port:
            parts = _loop(scenario, steady)
            record = _initial_arrays(scenario, plant.get(outputs), steady, parts)
            if watch is not None:
                watch(record)
            plant_port = plant.port(driven, outputs)
            raw = loop.Exit(*loop.run(plant_port, controller_port, parts, record))
            names = [variable.name for variable in observed]
            if raw.reason == loop.FINISHED:
                ending = _ending(raw, record, scenario, plant, controller)
                # While both instances live: a case whose verdict is in doubt goes
                # on from where it is, at the cost of the rest alone.
                later = further(_trajectory(scenario, record, raw, ending, names, steady))
                if later is not None:
                    parts, record = _loop(later, steady, scenario.samples), _longer(record, later.samples)
                    more = loop.Exit(*loop.run(plant_port, controller_port, parts, record))
                    raw, scenario = more._replace(warnings=raw.warnings + more.warnings), later
            ending = _ending(raw, record, scenario, plant, controller)
            if raw.reason not in (loop.PLANT_FAILED, loop.CONTROLLER_FAILED):  # the standards forbid it after an error
                ending = _terminated(ending, controller, plant)
    if changed := arithmetic_now():  # only now: what measures the trajectory would count otherwise, too
        message = _changed_arithmetic(controller, changed)
        ending = replace(ending, status=Status.ERROR, message=message)
    return _trajectory(scenario, record, raw, ending, names, steady)


def steady_state(plant: Slave, binding: Binding) -> Steady:
    """What the initialized plant publishes."""
    q_m_ref, u_m0, q_a = (plant.get(binding[name].variables) for name in ("q_m_ref", "u_m0", "q_a"))
    return Steady((q_m_ref[0], q_m_ref[1]), (u_m0[0], u_m0[1]), (q_a[0], q_a[1]))


def _loop(scenario: Scenario, steady: Steady, first: int = 0) -> loop.Loop:
    drive, sensor, seed = scenario.drive, scenario.sensor, scenario.sensor.noise.seed
    cells = random_streams.jitter_cells(seed, CELLS, scenario.samples + 1) if sensor.jitter else None
    return loop.Loop(
        first=first,
        samples=scenario.samples,
        plan=make_plan(scenario.sample_time, drive.delay, sensor.delay, scenario.longest_hold, sensor.jitter, cells),
        q_m_ref=np.array(steady.q_m_ref),
        u_m0=np.array(steady.u_m0),
        gain=np.array(drive.gain),
        limit=np.array(drive.limit),
        torque_quantum=np.array(drive.quantum),
        angle_quantum=sensor.quantum,
        noise=random_streams.noise(sensor.noise, scenario.samples + 1),
        dropped=random_streams.dropped(seed, drive.dropout, scenario.samples),
        chirp=chirp_signal(scenario.chirp, scenario.again),
        pulse=pulse_signal(scenario.pulse, scenario.again),
        abort_distance=scenario.abort_distance,
    )


def _initial_arrays(
    scenario: Scenario, outputs: Sequence[float], steady: Steady, parts: loop.Loop
) -> loop.SampleArrays:
    """Arrays with the initial state in row 0; a delayed sensor's line is filled with the reference."""
    record = _empty(scenario.samples, len(outputs))
    record.outputs[0] = outputs
    # A measurement between samples before t = 0 would need a plant that
    # ran earlier: it was at rest then, at the reference.
    taken_at_0 = [delay % scenario.sample_time == 0 for delay in scenario.sensor.delay]
    record.measured[0] = np.where(taken_at_0, record.outputs[0, :2] + parts.noise[0], steady.q_m_ref)
    return record


def _empty(samples: int, outputs: int) -> loop.SampleArrays:
    shapes = (samples + 1, outputs), (samples + 1, 2), *((samples, 2),) * 3
    # One block: NumPy asks for large pages from 4 MB on, and the faults of small ones take a third of the loop's time.
    ends = np.cumsum([math.prod(shape) for shape in shapes])
    pieces = np.split(np.empty(ends[-1]), ends[:-1])
    return loop.SampleArrays(*(piece.reshape(shape) for piece, shape in zip(pieces, shapes, strict=True)))


def _longer(record: loop.SampleArrays, samples: int) -> loop.SampleArrays:
    """The rows of ``record``, and room for those of all ``samples``."""
    longer = _empty(samples, record.outputs.shape[1])
    for new, old in zip(longer, record, strict=True):
        new[: len(old)] = old
    return longer


def _ending(
    raw: loop.Exit, record: loop.SampleArrays, scenario: Scenario, plant: Slave, controller: Slave | Remote
) -> Ending:
    time = float(raw.sample * scenario.sample_time)
    if raw.reason == loop.FINISHED:
        return Ending(Status.DONE, time, "", raw.warnings)
    lost = _lost(record.outputs[raw.sample], scenario)
    # A controller may refuse a measurement that is not finite.
    refused = raw.reason == loop.CONTROLLER_FAILED and raw.call == port.SET and raw.status < len(STATUS_WORDS)
    # Else the controller would be blamed for a plant with absurd parameters, of which it was given NaN.
    if (raw.reason in (loop.DIVERGED, loop.ABSURD_TORQUE) or refused) and lost:
        message = f"{plant.archive.name} {lost}: look at the plant's parameters"
        return Ending(Status.ERROR, time, message, raw.warnings)
    if raw.reason == loop.DIVERGED:
        message = f"the TCP was more than {scenario.abort_distance:g} m from where it began"
        return Ending(Status.UNSTABLE, time, message, raw.warnings)
    if raw.reason == loop.ABSURD_TORQUE:
        largest = loop.MAX_PHYSICAL_TORQUE
        message = f"{controller.archive.name} asked for a torque that is not a number or beyond {largest:g} N.m"
        return Ending(Status.ERROR, time, message, raw.warnings)
    if raw.reason == loop.ARITHMETIC_CHANGED:
        return Ending(Status.ERROR, time, _changed_arithmetic(controller, raw.status), raw.warnings)
    slave = plant if raw.reason == loop.PLANT_FAILED else controller
    failure = exchange_failure(slave, raw.call, raw.status)
    if isinstance(failure, Crash):
        raise failure
    return Ending(Status.ERROR, time, str(failure), raw.warnings, failure.call)


def _changed_arithmetic(controller: Slave | Remote, changed: int) -> str:
    return f"{controller.archive.name} changed how this process computes: {arithmetic_words(changed)}"


def _lost(outputs: np.ndarray, scenario: Scenario) -> str:
    """What shows that the plant's ``outputs`` (q_m, X, ...) are no motion of a manipulator; empty if nothing does."""
    if not np.all(np.isfinite(outputs)):
        return "gave outputs that are not finite numbers"
    if np.all(np.isfinite(scenario.drive.limit)) and np.max(np.abs(outputs[:2])) > MAX_MOTOR_ANGLE:
        return f"gave motor angles beyond {MAX_MOTOR_ANGLE:g} rad"
    return ""


def exchange_failure(slave: Slave | Remote, call: int, status: int) -> FmuError | Crash:
    """What :func:`~orchestrator.fmi.port.exchange` ended with, a status above WARNING, in words."""
    slave.broken = slave.broken or status == port.FATAL
    if status == port.LOST:
        return slave.lost()
    if status >= port.ARITHMETIC_CHANGED:
        return FmuError(_changed_arithmetic(slave, status - port.ARITHMETIC_CHANGED))
    name = slave.calls[("set", "step", "get")[call]]
    if status in STEPPING_WORDS:
        message = f"{slave.archive.name} {STEPPING_WORDS[status]}"
    elif status < len(STATUS_WORDS):
        message = f"{slave.archive.name}: {name} returned {STATUS_WORDS[status]}"
    else:
        # A status is a C int; the loop has it as a number without a sign, so that it can be compared.
        signed = status - (1 << 32 if status >= 1 << 31 else 0)
        message = f"{slave.archive.name}: {name} returned the illegal status {signed}"
    return FmuError(message, name, slave.messages())


def _terminated(ending: Ending, *slaves: Slave | Remote) -> Ending:
    """Ends the simulation of ``slaves``, too; a failure to do so is a warning and changes no result."""
    for slave in slaves:
        try:
            slave.terminate()
        # CATIA-Systems/FMPy#357: FMUs answer terminate with an error. All samples are there by then.
        except FmuError as problem:
            message = "\n  ".join(filter(None, (ending.message, f"after its end: {problem}")))
            ending = replace(ending, message=message, warnings=ending.warnings + 1)
    return ending


def _trajectory(
    scenario: Scenario,
    record: loop.SampleArrays,
    raw: loop.Exit,
    ending: Ending,
    observed: Sequence[str],
    steady: Steady,
) -> Trajectory:
    """The samples that were reached."""
    commands = raw.sample
    states = commands + 1
    interval = scenario.sample_time
    return Trajectory(
        time=np.arange(states) * interval.numerator / interval.denominator,
        q_m=record.outputs[:states, 0:2],
        X=record.outputs[:states, 2:4],
        extra={name: record.outputs[:states, 4 + column] for column, name in enumerate(observed)},
        measured=record.measured[:states],
        given=record.given[:commands],
        command=record.command[:commands],
        torque=record.torque[:commands],
        q_m_ref=steady.q_m_ref,
        u_m0=steady.u_m0,
        ending=ending,
    )
