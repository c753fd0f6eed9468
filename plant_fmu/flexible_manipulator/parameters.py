"""Table 1: the manipulator's physical parameters, their nominal values, units and physical ranges."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

ARC_MINUTE = math.pi / (180 * 60)
"""One minute of arc [rad]."""


@dataclass(frozen=True)
class Parameter:
    """One row of Table 1.

    ``nominal`` holds one value an axis (two) or one value for the whole robot (one); ``positive`` tells
    whether zero is outside the physical range. No parameter of the table may be negative.
    """

    symbol: str
    unit: str
    nominal: tuple[float, ...]
    description: str
    positive: bool = True

    def names(self) -> tuple[str, ...]:
        """FMI names of the row's variables: ``m[1]``, ``m[2]``, or the bare symbol."""
        if len(self.nominal) == 1:
            return (self.symbol,)
        return tuple(f"{self.symbol}[{axis}]" for axis in (1, 2))


TABLE_1: tuple[Parameter, ...] = (
    Parameter("j_m", "kg.m2", (0.004, 0.001), "motor inertia j_m, eq. (3a)"),
    Parameter("j", "kg.m2", (5.0, 50.0), "link inertia j about the centre of mass, eq. (3b)-(3d)"),
    Parameter("m", "kg", (50.0, 150.0), "link mass m, eq. (3b)-(3h)"),
    Parameter("l", "m", (1.0, 1.5), "link length l, eq. (3b), (9)"),
    Parameter("xi", "m", (0.5, 0.8), "distance xi of the centre of mass from the joint, eq. (3b)-(3h)", False),
    Parameter("n", "1", (200.0, 200.0), "gear ratio n, eq. (1)"),
    Parameter("k_low", "N.m/rad", (0.5e6, 0.2e6), "lowest gear stiffness k_low, at zero deflection, eq. (5c)"),
    Parameter("k_high", "N.m/rad", (1.5e6, 0.3e6), "gear stiffness k_high beyond the breakpoint, eq. (5f)"),
    Parameter("psi", "rad", (2 * ARC_MINUTE, 3 * ARC_MINUTE), "breakpoint deflection psi of the gear, eq. (5)"),
    Parameter("d", "N.m.s/rad", (600.0, 200.0), "gear damping d, eq. (6)", False),
    Parameter("f_d", "N.m.s/rad", (0.006, 0.003), "viscous motor friction f_d, eq. (8)", False),
    Parameter("f_c", "N.m", (1.5, 1.0), "Coulomb motor friction f_c, eq. (8)", False),
    Parameter("mu_k", "1", (0.5, 0.5), "kinetic share mu_k of the Coulomb friction, eq. (8)", False),
    Parameter("beta", "s/rad", (0.4, 0.4), "decay beta of the static friction over motor speed, eq. (8)", False),
    Parameter("alpha", "s/rad", (5.0, 5.0), "steepness alpha of the friction at zero speed, eq. (8)", False),
    Parameter("gamma", "1", (1.0, 1.0), "gain gamma of the motor torque control, Section 3"),
    Parameter("g", "m/s2", (9.81,), "gravitational acceleration g, eq. (3f)-(3g)", False),
)

NOMINAL: dict[str, float] = {
    name: value for row in TABLE_1 for name, value in zip(row.names(), row.nominal, strict=True)
}
"""Nominal value of every parameter by its FMI name, SI units."""


def check(values: Mapping[str, float]) -> None:
    """Raise ``ValueError`` for the first value outside its physical range.

    ``values`` maps every name of ``NOMINAL`` to a value in the SI unit of Table 1.
    """
    for row in TABLE_1:
        for name in row.names():
            value = values[name]
            if not math.isfinite(value) or value < 0 or (row.positive and value == 0):
                bound = "> 0" if row.positive else ">= 0"
                raise ValueError(
                    f"{name} = {value:g} {row.unit} is outside its physical range: "
                    f"{row.description} must be finite and {bound}"
                )
