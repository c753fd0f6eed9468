"""The closed loop of one case as a package of SSP 1.0, for other tools: plant, controller and imperfections with their
parameters. docs/plant.md tells in which order of exchange it has the bits of the master loop here."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from fractions import Fraction
from typing import Literal

from lxml import etree
from lxml.builder import ElementMaker

from controller_fmu.export.archive import pack

from ..codec import Scalar
from ..errors import InputError
from ..fmi.archive import Archive
from ..loop.controller import Steady, start_values
from ..loop.random_streams import stable_stream
from ..loop.scenario import Scenario, make_plan
from ..loop.setup import Setup, controller_binding
from ..text import spelled

PARAMETERS = "case"
"""Name of the parameter sets."""

STRONGEST = 1e12
"""Stands for no limit of the torque [N.m]: XML Schema's infinity is not read everywhere."""

Order = Literal["parallel", "in-sequence"]
"""How a master exchanges what the FMUs compute: each with a step of its own, and results are passed on as soon as they
are computed; or all with the sample time, and each output is read after the inputs that it depends on."""

_SITE = "http://ssp-standard.org/SSP1/SystemStructure"
_NAMESPACES = {
    "ssd": f"{_SITE}Description",
    "ssc": f"{_SITE}Common",
    "ssv": f"{_SITE}ParameterValues",
    "osp": "http://opensimulationplatform.com/SSP/OSPAnnotations",
    "oms": "https://raw.githubusercontent.com/OpenModelica/OMSimulator/master/schema/oms.xsd",
}
_ssd, _ssc, _ssv, _osp, _oms = (ElementMaker(namespace=uri, nsmap=_NAMESPACES) for uri in _NAMESPACES.values())

Values = Mapping[str, Scalar]

ELEMENTS = {bool: "Boolean", int: "Integer", float: "Real", str: "String"}
"""Elements of SSV by the type of a value."""


def package(
    plant: Archive,
    imperfections: Archive,
    controller: Archive,
    setup: Setup,
    scenario: Scenario,
    steady: Steady,
    order: Order,
) -> bytes:
    """The bytes of the package for masters of this ``order``; equal arguments give equal bytes.

    There are two, since OMSimulator, which exchanges in sequence, refuses annotations of a component, and they are the
    only place for the steps that masters need for the order in parallel.

    Raises :class:`~orchestrator.errors.InputError` if the loop cannot be had so: the plant's steps within a sample
    have different lengths, or no torque is delayed by one of them; samples are dropped, measurements have jitter, or
    disturbances come again; or the controller has arrays.
    """
    tick = tick_of(scenario)
    binding = controller_binding(controller, setup)
    angles, torques = binding["e" if "e" in binding else "q_m"], binding["u_m"]
    before, within = start_values(controller, binding, setup, steady, scenario.sample_time)
    starts = before | within
    if arrays := [v.name for v in (*starts, *angles.variables, *torques.variables) if v.size > 1]:
        message = f"The controller {controller.name} has the array {arrays[0]}, and SSP 1.0 knows scalars only."
        raise InputError(message, "no-ssp", controller.name, arrays[0])
    if other := [v.name for v in starts if v.type in ("Enumeration", "Binary")]:
        message = f"The controller {controller.name} is given {other[0]}, of a type that the package does not have."
        raise InputError(message, "no-ssp", controller.name, other[0])
    components: dict[str, tuple[Archive, Values, Fraction]] = {
        "plant": (plant, dict(scenario.parameters), tick),
        "imperfections": (imperfections, {**_steady(steady), **imperfection_values(scenario)}, tick / 2),
        "controller": (controller, {v.name: value for v, (value,) in starts.items()}, scenario.sample_time),
    }
    scales = [(-1.0 if angles.connector.name == "e" else 1.0) / factor for factor in angles.factors]
    offsets = [-scale * q if scale < 0.0 else 0.0 for scale, q in zip(scales, steady.q_m_ref, strict=True)]
    lines = [
        *(("plant", f"q_m[{i}]", "imperfections", f"q_m[{i}]", 1.0, 0.0) for i in (1, 2)),
        *(("imperfections", f"{n}[{i}]", "plant", f"{n}[{i}]", 1.0, 0.0) for n in ("u_m", "u_d", "F") for i in (1, 2)),
        *(
            ("imperfections", f"y[{i}]", "controller", angles.variables[i - 1].name, scales[i - 1], offsets[i - 1])
            for i in (1, 2)
        ),
        *(
            ("controller", torques.variables[i - 1].name, "imperfections", f"u_c[{i}]", torques.factors[i - 1], 0.0)
            for i in (1, 2)
        ),
    ]
    files = {f"resources/{name}.ssv": _text(_values(values)) for name, (_, values, _) in components.items()}
    files |= {f"resources/{name}.fmu": archive.file.read_bytes() for name, (archive, _, _) in components.items()}
    files["SystemStructure.ssd"] = _text(_structure(components, lines, scenario, order))
    return pack(files)


def tick_of(scenario: Scenario) -> Fraction:
    """The step of the plant [s].

    Raises :class:`~orchestrator.errors.InputError` if samples are dropped, measurements have jitter, or disturbances
    come again.
    """
    drive, sensor = scenario.drive, scenario.sensor
    if drive.dropout or sensor.jitter:
        raise InputError("An SSP package has neither dropped samples nor jitter.", "no-ssp")
    if scenario.again.number > 1:
        message = "The FMU of the imperfections has each disturbance once; in this case they come "
        raise InputError(f"{message}{scenario.again.number} times.", "no-ssp")
    plan = make_plan(scenario.sample_time, drive.delay, sensor.delay, scenario.longest_hold)
    return scenario.sample_time / plan.step.size


def _steady(steady: Steady) -> Values:
    return _by_element({"q_m_ref": steady.q_m_ref, "u_m0": steady.u_m0})


def imperfection_values(scenario: Scenario) -> dict[str, float]:
    """The parameters of the FMU, but for the steady state; times are exact there if ticks and delays are whole.

    Raises :class:`~orchestrator.errors.InputError` if there are no such ticks.
    """
    drive, sensor, chirp, pulse = scenario.drive, scenario.sensor, scenario.chirp, scenario.pulse
    tick = tick_of(scenario)
    exact = {"sensor_delay": [d / tick for d in sensor.delay], "drive_delay": [d / tick for d in drive.delay]}
    if (1 / tick).denominator != 1 or any(d.denominator != 1 for pair in exact.values() for d in pair):
        message = f"The delays split the sample time of {float(scenario.sample_time):g} s unevenly, or it is no "
        raise InputError(f"{message}whole fraction of a second: there is no step for other tools.", "no-ssp")
    if min(exact["drive_delay"]) < 1:
        message = "An SSP package needs a delay of the torque: other tools do not define the order of exchange without "
        raise InputError(f"{message}one.", "no-ssp")
    random = stable_stream(sensor.noise.seed).get_state(legacy=False)["state"]
    pairs: dict[str, Iterable[float]] = {
        **{name: map(float, pair) for name, pair in exact.items()},
        "gain": drive.gain,
        "limit": [min(limit, STRONGEST) for limit in drive.limit],
        "torque_quantum": drive.quantum,
        "noise_state": _words(random["state"]),
        "noise_increment": _words(random["inc"]),
        "chirp_amplitude": chirp.amplitude,
        "force": pulse.force,
    }
    return {
        **_by_element(pairs),
        "rate": float(1 / tick),
        "ticks_per_sample": float(scenario.sample_time / tick),
        "angle_quantum": sensor.quantum,
        "sigma": sensor.noise.sigma,
        **{f"chirp_{name}": getattr(chirp, name) for name in ("start", "stop", "f_start", "f_stop")},
        **{f"force_{name}": getattr(pulse, name) for name in ("start", "stop")},
    }


def _by_element(pairs: Mapping[str, Iterable[float]]) -> dict[str, float]:
    return {f"{name}[{i}]": value for name, pair in pairs.items() for i, value in enumerate(pair, start=1)}


def _words(number: int) -> list[float]:
    """A number of 128 bits as 32-bit words, the highest first: each is exact as a float."""
    return [float(number >> shift & 0xFFFFFFFF) for shift in (96, 64, 32, 0)]


def _values(values: Values) -> etree._Element:
    listed = [
        _ssv.Parameter(_ssv(ELEMENTS[type(value)], value=spelled(value)), name=name) for name, value in values.items()
    ]
    return _ssv.ParameterSet(_ssv.Parameters(*listed), version="1.0", name=PARAMETERS)


def _structure(
    components: Mapping[str, tuple[Archive, Values, Fraction]],
    lines: list[tuple[str, str, str, str, float, float]],
    scenario: Scenario,
    order: Order,
) -> etree._Element:
    is_parallel = order == "parallel"
    elements = _ssd.Elements()
    for name, (_, _, step) in components.items():
        ports = {line[1]: "output" for line in lines if line[0] == name}
        ports |= {line[3]: "input" for line in lines if line[2] == name}
        hints = [_annotations("com.opensimulationplatform", _osp.StepSizeHint(value=repr(float(step))))]
        elements.append(
            _ssd.Component(
                _ssd.Connectors(*(_ssd.Connector(_ssc.Real(), name=port, kind=kind) for port, kind in ports.items())),
                _ssd.ParameterBindings(_ssd.ParameterBinding(source=f"resources/{name}.ssv")),
                *(hints if is_parallel else ()),
                name=name,
                source=f"resources/{name}.fmu",
            )
        )
    connections = _ssd.Connections()
    for start, output, end, port, factor, offset in lines:
        ends = {"startElement": start, "startConnector": output, "endElement": end, "endConnector": port}
        connections.append(_ssd.Connection(ends))
        if (factor, offset) != (1.0, 0.0):
            connections[-1].append(_ssc.LinearTransformation(factor=repr(factor), offset=repr(offset)))
    master = _oms.FixedStepMaster(
        description="oms-ma", stepSize=repr(float(scenario.sample_time)), relativeTolerance="1e-4"
    )
    experiment = {"startTime": "0", "stopTime": repr(float(scenario.samples * scenario.sample_time))}
    return _ssd.SystemStructureDescription(
        _ssd.System(elements, connections, *(() if is_parallel else (_of_openmodelica(master),)), name="loop"),
        _ssd.DefaultExperiment(experiment, *(() if is_parallel else (_of_openmodelica(),))),
        version="1.0",
        name="flexible_manipulator",
    )


def _of_openmodelica(*information: etree._Element) -> etree._Element:
    return _annotations("org.openmodelica", _oms.Annotations(_oms.SimulationInformation(*information)))


def _annotations(vendor: str, content: etree._Element) -> etree._Element:
    return _ssd.Annotations(_ssc.Annotation(content, type=vendor))


def _text(root: etree._Element) -> bytes:
    text: bytes = etree.tostring(root, encoding="UTF-8", xml_declaration=True, pretty_print=True)
    return text
