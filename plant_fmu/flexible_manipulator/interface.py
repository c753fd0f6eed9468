"""The FMU's connectors: name, causality, unit and meaning of every variable, in the order of value references."""

from __future__ import annotations

from dataclasses import dataclass

from .parameters import TABLE_1


@dataclass(frozen=True)
class Variable:
    """A scalar variable of the FMU. ``start`` is None where the FMU computes the value."""

    name: str
    causality: str
    unit: str
    start: float | None
    description: str


def pair(
    name: str, causality: str, unit: str, start: float | None, description: str, axes: tuple[str, str]
) -> tuple[Variable, Variable]:
    """The two components ``name[1]``, ``name[2]`` of a connector."""
    first, second = (
        Variable(f"{name}[{i}]", causality, unit, start, f"{description}, {axis}")
        for i, axis in enumerate(axes, start=1)
    )
    return first, second


AXES = ("axis 1", "axis 2")
PLANE = ("x", "z")

VARIABLES: tuple[Variable, ...] = (
    *pair("u_m", "input", "N.m", 0.0, "motor torque u_m as commanded to the drive, eq. (1)", AXES),
    *pair("u_d", "input", "N.m", 0.0, "motor torque disturbance u_d, eq. (1)", AXES),
    *pair("F", "input", "N", 0.0, "disturbance force F on the tool, eq. (10)", PLANE),
    *pair("q_m", "output", "rad", None, "motor angle q_m, eq. (1)", AXES),
    *pair("q_a", "output", "rad", None, "link angle q_a, eq. (1)", AXES),
    *pair("X", "output", "m", None, "position X of the tool centre point, eq. (9)", PLANE),
    *pair("q_m_ref", "calculatedParameter", "rad", None, "motor angle in the initial steady state, Section 6", AXES),
    *pair(
        "u_m0", "calculatedParameter", "N.m", None, "torque u_m to command in the initial steady state, Section 6", AXES
    ),
    *pair("q_a_start", "parameter", "rad", 0.0, "link angle q_a in the initial steady state", AXES),
    *(
        Variable(name, "parameter", row.unit, start, row.description + (f", axis {name[-2]}" if "[" in name else ""))
        for row in TABLE_1
        for name, start in zip(row.names(), row.nominal, strict=True)
    ),
)

UNITS: dict[str, str] = {variable.name.split("[")[0]: variable.unit for variable in VARIABLES}
"""Unit of every variable by its name without index."""
