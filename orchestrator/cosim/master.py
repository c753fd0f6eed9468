"""The master: two slaves and a scenario in, a trajectory out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from . import fmi2, loop, signals
from .connectors import CONTROLLER, PLANT, Binding, bind, references
from .plan import make_plan
from .scenario import Pair, Scenario
from .trajectory import Ending, Status, Trajectory

FMI_STATUS = ("ok", "warning", "discard", "error", "fatal", "pending")
FMI_CALL = {loop.SET: "fmi2SetReal", loop.STEP: "fmi2DoStep", loop.GET: "fmi2GetReal"}


def simulate(
    plant: fmi2.Slave,
    controller: fmi2.Slave,
    scenario: Scenario,
    controller_parameters: Mapping[str, float] | None = None,
    observe: Sequence[str] = (),
) -> Trajectory:
    """Simulate the closed loop of ``scenario``.

    The plant is initialized first; the steady state it publishes, q_m_ref and u_m0, is what the controller is
    initialized with. ``observe`` names further plant outputs to record. Raises :class:`~orchestrator.errors.FmuError`
    where an FMU fails before the first sample, :class:`~orchestrator.errors.InputError` where a name is unknown;
    what happens later is told by the trajectory's ending.
    """
    plant_binding, controller_binding = bindings(plant, controller)
    given = dict(scenario.parameters)
    parameters = references(plant.archive.description, "parameter", given, f"The plant {plant.archive.name}")
    observed = references(plant.archive.description, "output", observe, f"The plant {plant.archive.name}")
    own = dict(controller_parameters or {})
    own_references = references(
        controller.archive.description, "parameter", own, f"The controller {controller.archive.name}"
    )
    stop_time = float(scenario.samples * scenario.sample_time)

    with plant.instantiated(stop_time), controller.instantiated(stop_time):
        plant.initialize({parameters[name]: value for name, value in given.items()}, {})
        q_m_ref, u_m0 = (_pair(plant.get(plant_binding[name].references)) for name in ("q_m_ref", "u_m0"))

        # At rest the sensor shows the reference; with equal values in initialization mode it makes no difference
        # whether an exporter takes its first sample there or in the first step.
        known = {"q_m_ref": q_m_ref, "q_m": q_m_ref, "u_m0": u_m0}
        before = {own_references[name]: value for name, value in own.items()}
        within: dict[int, float] = {}
        for name, bound in controller_binding.items():
            if name in known:
                values = before if bound.causality == "parameter" else within
                values.update(zip(bound.references, known[name], strict=True))
        controller.initialize(before, within)

        plant_inputs = [vr for name in ("u_m", "u_d", "F") for vr in plant_binding[name].references]
        plant_outputs = [vr for name in ("q_m", "X") for vr in plant_binding[name].references] + list(observed.values())
        plant_port = _port(plant, plant_inputs, plant_outputs)
        controller_port = _port(controller, controller_binding["q_m"].references, controller_binding["u_m"].references)
        parts = _loop(scenario, q_m_ref, u_m0)
        record = _record(scenario, plant.get(plant_outputs), q_m_ref, parts)
        raw = loop.Ending(*loop.run(plant_port, controller_port, parts, record))
        ending = _ending(raw, scenario, plant, controller)
        if raw.reason in (loop.FINISHED, loop.DIVERGED, loop.ABSURD_TORQUE):
            plant.terminate()
            controller.terminate()
    return _trajectory(scenario, record, raw, ending, list(observed), q_m_ref, u_m0)


def bindings(plant: fmi2.Slave, controller: fmi2.Slave) -> tuple[Binding, Binding]:
    """The connectors of both FMUs; raises :class:`~orchestrator.errors.InputError` where one is missing."""
    return (
        bind(plant.archive.description, PLANT, f"The plant {plant.archive.name}"),
        bind(controller.archive.description, CONTROLLER, f"The controller {controller.archive.name}"),
    )


def _pair(values: Sequence[float]) -> Pair:
    first, second = values
    return first, second


def _port(slave: fmi2.Slave, inputs: Sequence[int], outputs: Sequence[int]) -> loop.Port:
    return loop.Port(
        instance=slave.instance,
        set_real=slave.address("fmi2SetReal"),
        do_step=slave.address("fmi2DoStep"),
        get_real=slave.address("fmi2GetReal"),
        inputs=np.array(inputs, dtype=np.uint32),
        input_values=np.zeros(len(inputs)),
        outputs=np.array(outputs, dtype=np.uint32),
        output_values=np.zeros(len(outputs)),
        offset=np.zeros(2),
        scale=np.ones(2),
        output_scale=np.ones(2),
    )


def _loop(scenario: Scenario, q_m_ref: Pair, u_m0: Pair) -> loop.Loop:
    drive, sensor, chirp, pulse = scenario.drive, scenario.sensor, scenario.chirp, scenario.pulse
    return loop.Loop(
        samples=scenario.samples,
        plan=make_plan(scenario.sample_time, drive.delay, sensor.delay),
        q_m_ref=np.array(q_m_ref),
        u_m0=np.array(u_m0),
        gain=np.array(drive.gain),
        limit=np.array(drive.limit),
        torque_quantum=np.array(drive.quantum),
        angle_quantum=sensor.quantum,
        noise=signals.noise(sensor.noise, scenario.samples + 1),
        chirp=signals.ChirpSignal(*chirp.amplitude, chirp.start, chirp.stop, chirp.f_start, chirp.f_stop),
        pulse=signals.PulseSignal(*pulse.force, pulse.start, pulse.stop),
        abort_distance=scenario.abort_distance,
    )


def _record(scenario: Scenario, outputs: Sequence[float], q_m_ref: Pair, parts: loop.Loop) -> loop.Record:
    """Empty arrays with the initial state in row 0; a delayed sensor's line is filled with the reference."""
    samples = scenario.samples
    record = loop.Record(
        outputs=np.empty((samples + 1, len(outputs))),
        measured=np.empty((samples + 1, 2)),
        command=np.empty((samples, 2)),
        torque=np.empty((samples, 2)),
    )
    record.outputs[0] = outputs
    taken_at_0 = [delay % scenario.sample_time == 0 for delay in scenario.sensor.delay]
    record.measured[0] = np.where(taken_at_0, record.outputs[0, :2] + parts.noise[0], q_m_ref)
    return record


def _ending(raw: loop.Ending, scenario: Scenario, plant: fmi2.Slave, controller: fmi2.Slave) -> Ending:
    time = float(raw.sample * scenario.sample_time)
    if raw.reason == loop.FINISHED:
        return Ending(Status.DONE, time, "", raw.warnings)
    if raw.reason == loop.DIVERGED:
        message = f"the TCP was more than {scenario.abort_distance:g} m from where it began"
        return Ending(Status.UNSTABLE, time, message, raw.warnings)
    if raw.reason == loop.ABSURD_TORQUE:
        message = f"{controller.archive.name} asked for a torque that is no number or beyond {loop.ABSURD:g} N.m"
        return Ending(Status.ERROR, time, message, raw.warnings)
    slave = plant if raw.reason == loop.PLANT_FAILED else controller
    name = FMI_STATUS[raw.status] if 0 <= raw.status < len(FMI_STATUS) else f"the illegal status {raw.status}"
    message = "\n  ".join((f"{slave.archive.name}: {FMI_CALL[raw.call]} returned {name}", *fmi2.log()))
    return Ending(Status.ERROR, time, message, raw.warnings, FMI_CALL[raw.call])


def _trajectory(
    scenario: Scenario,
    record: loop.Record,
    raw: loop.Ending,
    ending: Ending,
    observed: Sequence[str],
    q_m_ref: Pair,
    u_m0: Pair,
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
        command=record.command[:commands],
        torque=record.torque[:commands],
        q_m_ref=q_m_ref,
        u_m0=u_m0,
        ending=ending,
    )
