"""The controller's side of the loop: bound, initialized in the plant's steady state, ready to be stepped."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from fractions import Fraction
from typing import Protocol

import numpy as np

from ..codec import Scalar
from ..errors import Crash, FmuError
from ..fmi.archive import Archive
from ..fmi.connectors import Binding
from ..fmi.lookup import find_values
from ..fmi.port import Port
from ..fmi.slaves import Slave
from ..fmi.variables import Variable, conversion
from .scenario import Pair
from .setup import Setup, controller_binding, sample_time_parameter


@dataclass(frozen=True)
class Steady:
    """The plant's steady state: motor angles, torques to command, link angles [rad, N.m, rad]."""

    q_m_ref: Pair
    u_m0: Pair
    q_a_ref: Pair


class Named(Protocol):
    """What messages call by its name."""

    @property
    def name(self) -> str:
        """Such as the file name of an FMU."""


class Remote(Protocol):
    """A controller in another process, as the loop sees it; its signals are in SI units."""

    @property
    def archive(self) -> Named:
        """What it is."""

    @property
    def calls(self) -> Mapping[str, str]:
        """As those of a slave."""

    broken: bool
    """As that of a slave."""

    def prepared(
        self, setup: Setup, steady: Steady, sample_time: Fraction, stop_time: float, first: Pair | None
    ) -> AbstractContextManager[Port]:
        """As :func:`prepared`, there."""

    def messages(self) -> tuple[str, ...]:
        """What the instance has said last."""

    def terminate(self) -> None:
        """End the simulation of the instance."""

    def lost(self) -> Crash:
        """What became of its process, which gives no answer."""


@contextmanager
def prepared(
    slave: Slave | Remote,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    stop_time: float,
    first: Pair | None = None,
) -> Iterator[Port]:
    """An instance of the controller, initialized at rest; ends with the block.

    ``first`` are the motor angles [rad] it sees during initialization, q_m_ref unless said otherwise: at rest the
    sensor shows the reference, and with equal values in initialization mode it makes no difference whether an
    exporter takes its first sample there or in the first step.
    """
    if not isinstance(slave, Slave):
        with slave.prepared(setup, steady, sample_time, stop_time, first) as port:
            yield port
        return
    binding = controller_binding(slave.archive, setup)
    before, within = start_values(slave.archive, binding, setup, steady, sample_time, first)
    with slave.instantiated(not_before_the_last_step(stop_time, float(sample_time))):
        slave.initialize(before, within)
        # pythonfmu imports in doStep as well: a law that loads a module at its first sample must find its own.
        with slave.own_modules():
            yield _port(slave, binding, steady)


def not_before_the_last_step(stop_time: float, step: float) -> float:
    """The stop time [s] that a controller is told. The end of its last step, the sum of two numbers, may be rounded to
    one beyond the stop time, and some FMUs refuse a step that goes beyond it by however little."""
    last = (round(stop_time / step) - 1) * step + step
    return last if 0.0 < last - stop_time < 1e-6 * step else stop_time


@contextmanager
def probed(
    slave: Slave | Remote,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    stop_time: float,
    first: Pair | None = None,
) -> Iterator[Port]:
    """As :func:`prepared`, and terminated as after a case: some FMUs clear their static memory only there."""
    with prepared(slave, setup, steady, sample_time, stop_time, first) as port:
        yield port
        with suppress(FmuError):  # the check says so
            slave.terminate()


def start_values(
    controller: Archive,
    binding: Binding,
    setup: Setup,
    steady: Steady,
    sample_time: Fraction,
    first: Pair | None = None,
) -> tuple[dict[Variable, list[Scalar]], dict[Variable, list[Scalar]]]:
    """What a controller is given before initialization, parameters, and within it, inputs, of which those that nothing
    drives keep their values; ``first`` as in :func:`prepared`."""
    what = f"The controller {controller.name}"
    driven = [v for bound in binding.values() for v in bound.variables if v.causality == "input"]
    given = find_values(controller.description, setup.parameters, what, driven)
    before = {variable: values for variable, values in given.items() if variable.causality == "parameter"}
    within = {variable: values for variable, values in given.items() if variable.causality == "input"}
    T_s = sample_time_parameter(controller, setup)
    if T_s is not None:
        unit = conversion(controller.description, T_s.unit, "s", f"{what}: {T_s.name}")
        before[T_s] = [float(sample_time) / unit.factor]
    seen = steady.q_m_ref if first is None else first
    pairs = {
        "q_m_ref": steady.q_m_ref,
        "q_m": seen,
        "e": (steady.q_m_ref[0] - seen[0], steady.q_m_ref[1] - seen[1]),
        "u_m0": steady.u_m0,
        "q_a_ref": steady.q_a_ref,
    }
    for name, pair in pairs.items():
        if name in binding:
            (before if binding[name].is_parameter else within).update(binding[name].values(pair))
    return before, within


def _port(slave: Slave, binding: Binding, steady: Steady) -> Port:
    """The controller's port with the units of both sides, and the position error formed if that is its input."""
    measured, torque = binding["e" if "e" in binding else "q_m"], binding["u_m"]
    port = slave.port(measured.variables, torque.variables)
    to_input = 1.0 / np.array(measured.factors)
    if measured.connector.name == "e":
        port = port._replace(offset=np.array(steady.q_m_ref), scale=-to_input)
    else:
        port = port._replace(scale=to_input)
    return port._replace(output_scale=np.array(torque.factors))
