"""The variables of the LQG's FMUs, in Python and in C: names, units, ranges and descriptions, each said here alone.

A group of parameters is a named tuple whose fields are annotated with unit, description and smallest value.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Annotated, Any, NamedTuple, TypeVar, get_origin, get_type_hints

Group = TypeVar("Group")
Pair = tuple[float, float]
"""One value an axis."""
POSITIVE = 1e-9
"""Smallest value of what must not be zero, in its unit."""


class Variable(NamedTuple):
    """A variable of the FMU, a scalar or a pair; ``least`` is the smallest value allowed, None if there is none."""

    name: str
    causality: str
    is_pair: bool
    unit: str
    description: str
    least: float | None = None

    @property
    def names(self) -> tuple[str, ...]:
        """The FMI names, ``("q_m[1]", "q_m[2]")`` or ``("T_s",)``."""
        return (f"{self.name}[1]", f"{self.name}[2]") if self.is_pair else (self.name,)


CONNECTORS = (
    Variable("q_m_ref", "input", True, "rad", "Motor position reference"),
    Variable("q_m", "input", True, "rad", "Measured motor position"),
    Variable("u_m", "output", True, "N.m", "Motor torque command"),
    Variable("T_s", "parameter", False, "s", "Sample time; the communication step must equal it"),
    Variable("u_m0", "parameter", True, "N.m", "Motor torque in the initial steady state"),
)
"""Variables that all controllers have; they begin at zero, but for the sample time."""

SAMPLE_TIME = 0.25e-3
"""Start value of T_s [s]."""

BASE_UNITS = {
    "mm/rad": {"m": 1, "rad": -1, "factor": 1e-3},
    "mm/(N.m)": {"kg": -1, "m": -1, "s": 2, "factor": 1e-3},
}
"""Units of the cost's weights, which count TCP errors in millimetres."""


class Weights(NamedTuple):
    """What a designer chooses."""

    stiffness: Annotated[Pair, "1", "Gear stiffness of the model relative to k_low at zero load", POSITIVE]
    hardening: Annotated[float, "1", "Exponent with which the model's stiffness follows the local slope", 0.0]
    friction: Annotated[Pair, "N.m.s/rad", "Effective viscous motor friction of the model", 0.0]
    drift: Annotated[Pair, "N.m", "Motor torque disturbance: step of its random walk, the integral action", POSITIVE]
    motor_noise: Annotated[Pair, "N.m", "White motor torque, standard deviation of a sample", 0.0]
    arm_noise: Annotated[float, "N.m", "White torque on each link, standard deviation of a sample", 0.0]
    push: Annotated[float, "N.m", "Torque of an outer force on the links, standard deviation", 0.0]
    push_time: Annotated[float, "s", "Correlation time of the torque of an outer force", POSITIVE]
    angle_noise: Annotated[float, "rad", "Measurement noise beside the quantization, standard deviation", 0.0]
    velocity: Annotated[float, "s", "Time that turns TCP velocity into an error in the cost", 0.0]
    motor_angle: Annotated[float, "mm/rad", "Cost of the motor angle's deviation, in TCP error", 0.0]
    effort: Annotated[Pair, "mm/(N.m)", "Cost of torque, in TCP error", POSITIVE]


def parameters(group: Callable[..., Any]) -> tuple[Variable, ...]:
    """The parameters in a named tuple like :class:`Weights`."""
    found = []
    for name, hint in get_type_hints(group, include_extras=True).items():
        unit, description, least = hint.__metadata__
        found.append(Variable(name, "parameter", get_origin(hint.__origin__) is tuple, unit, description, least))
    return tuple(found)


def chosen(group: Callable[..., Group], values: Mapping[str, float]) -> Group:
    """The ``group`` among ``values`` by FMI name; raises :class:`ValueError` with the name of a bad one."""
    fields: list[float | tuple[float, ...]] = []
    for row in parameters(group):
        least = row.least or 0.0
        for name in row.names:
            if not least <= values[name] < math.inf:
                raise ValueError(
                    f"parameter {name} = {values[name]!r} {row.unit}: it must be finite and at least {least:g}"
                )
        numbers = tuple(values[name] for name in row.names)
        fields.append(numbers if row.is_pair else numbers[0])
    return group(*fields)
