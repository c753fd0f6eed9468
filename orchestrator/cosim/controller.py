"""The controller's side of the loop: bound, initialized in the plant's steady state, ready to be stepped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field
from fractions import Fraction

import numpy as np

from ..errors import InputError
from .archive import Archive
from .connectors import SAMPLE_TIME, Binding, bind_controller
from .lookup import find_parameters
from .names import canonical
from .port import Port
from .scenario import Pair
from .slaves import Slave
from .units import conversion
from .variables import Variable, variables


@dataclass(frozen=True)
class Setup:
    """How a controller is used: ``parameters`` by name (in the FMU's units), ``mapping`` from connectors to its
    variables."""

    parameters: Mapping[str, float] = field(default_factory=dict)
    mapping: Mapping[str, str] = field(default_factory=dict)


@dataclass(frozen=True)
class Steady:
    """The plant's steady state: motor angles, torques to command, link angles [rad, N.m, rad]."""

    q_m_ref: Pair
    u_m0: Pair
    q_a_ref: Pair


def controller_binding(controller: Archive, setup: Setup) -> Binding:
    """The controller's connectors.

    Raises :class:`~orchestrator.errors.InputError` where they do not fit, or ``setup`` gives a value to one of them.
    """
    binding = bind_controller(controller.description, f"The controller {controller.name}", setup.mapping)
    connected = {variable.name: name for name, bound in binding.items() for variable in bound.variables}
    for name in setup.parameters:
        connector = connected.get(name) or connected.get(name.partition("[")[0])
        if connector is not None and binding[connector].is_parameter:
            raise InputError(
                f"The controller {controller.name}: {name} is the connector {connector}, which the benchmark gives its "
                "value in every case. Leave it out of --set and of parameter files."
            )
    return binding


def sample_time_parameter(controller: Archive, setup: Setup) -> Variable | None:
    """The controller's parameter T_s, where it has one that ``setup`` leaves to the benchmark.

    The exact name goes above others that spell the same, as at connectors; raises
    :class:`~orchestrator.errors.InputError` where there are several of these.
    """
    scalars = [v for v in variables(controller.description).values() if v.is_real and v.size == 1]
    parameters = [v for v in scalars if v.causality == "parameter"]
    alike = [v for v in parameters if canonical(v.name.split(".")[-1]) == canonical(SAMPLE_TIME)]
    candidates = [v for v in alike if v.name == SAMPLE_TIME] or alike
    if any(v.name in setup.parameters for v in candidates):
        return None
    if len(candidates) > 1:
        names = ", ".join(v.name for v in candidates)
        raise InputError(
            f"The controller {controller.name} has more than one candidate for its sample time {SAMPLE_TIME}: {names}. "
            f"Set it yourself, such as --set {candidates[0].name}=0.00025, or rename it to {SAMPLE_TIME}."
        )
    return candidates[0] if candidates else None


@contextmanager
def prepared(
    slave: Slave, setup: Setup, steady: Steady, sample_time: Fraction, stop_time: float, first: Pair | None = None
) -> Iterator[Port]:
    """An instance of the controller, initialized at rest; ends with the block.

    ``first`` are the motor angles [rad] it sees during initialization, q_m_ref unless said otherwise: at rest the
    sensor shows the reference, and with equal values in initialization mode it makes no difference whether an
    exporter takes its first sample there or in the first step.
    """
    binding = controller_binding(slave.archive, setup)
    what = f"The controller {slave.archive.name}"
    before = find_parameters(slave.archive.description, setup.parameters, what)
    T_s = sample_time_parameter(slave.archive, setup)
    if T_s is not None:
        unit = conversion(slave.archive.description, T_s.unit, "s", f"{what}: {T_s.name}")
        before[T_s] = [float(sample_time) / unit.factor]
    seen = steady.q_m_ref if first is None else first
    known = {
        "q_m_ref": steady.q_m_ref,
        "q_m": seen,
        "e": (steady.q_m_ref[0] - seen[0], steady.q_m_ref[1] - seen[1]),
        "u_m0": steady.u_m0,
        "q_a_ref": steady.q_a_ref,
    }
    within: dict[Variable, list[float]] = {}
    for name, pair in known.items():
        if name in binding:
            (before if binding[name].is_parameter else within).update(binding[name].values(pair))

    with slave.instantiated(stop_time):
        slave.initialize(before, within)
        with slave.own_modules():
            yield _port(slave, binding, steady)


def _port(slave: Slave, binding: Binding, steady: Steady) -> Port:
    """The controller's port with the units of both sides, and the error formed where that is what it wants."""
    measured, torque = binding["e" if "e" in binding else "q_m"], binding["u_m"]
    port = slave.port(measured.variables, torque.variables)
    to_input = 1.0 / np.array(measured.factors)
    if measured.connector.name == "e":
        port = port._replace(offset=np.array(steady.q_m_ref), scale=-to_input)
    else:
        port = port._replace(scale=to_input)
    return port._replace(output_scale=np.array(torque.factors))
