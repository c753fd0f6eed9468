"""Manipulators for tests: tables of parameters, random members of the uncertainty, the plant's memory."""

import math
from collections.abc import Mapping

import numpy as np
from hypothesis import strategies as st

from plant_fmu.flexible_manipulator import coefficients, equilibrium, integrator, kinematics
from plant_fmu.flexible_manipulator.parameters import NOMINAL

T_S = 0.25e-3

HALF_WIDTHS = {
    **dict.fromkeys(("k_low", "k_high", "psi", "d"), 0.2),
    **dict.fromkeys(("mu_k", "beta", "alpha"), 0.5),
    "m": 0.1,
    "f_d": 0.8,
    "f_c": 0.8,
    "gamma": 0.1,
}
"""The uncertainty of Table 1, relative to nominal."""

CORNERS = [(math.radians(q_a1), math.radians(q_a2)) for q_a1 in (-90, 180) for q_a2 in (-180, 80)]
"""The corners of the workspace [rad]."""

workspace = st.tuples(st.floats(-math.pi / 2, math.pi), st.floats(-math.pi, math.radians(80)))
"""Link angles (q_a1, q_a2) [rad]."""


def table(**factors: float) -> dict[str, float]:
    """Table 1 with the parameters of a symbol multiplied on both axes: ``table(f_c=1.8)``."""
    return {name: value * factors.get(name.partition("[")[0], 1.0) for name, value in NOMINAL.items()}


@st.composite
def uncertain_tables(draw: st.DrawFn, swapped_stiffness: bool = True) -> dict[str, float]:
    """A member of the uncertainty of Table 1, each parameter and axis on its own.

    Some have k_high below k_low on an axis: the scan of Table 1 may be read so, and it is allowed.
    """
    values = dict(NOMINAL)
    for symbol, half_width in HALF_WIDTHS.items():
        for axis in (1, 2):
            values[f"{symbol}[{axis}]"] *= 1.0 + half_width * draw(st.floats(-1.0, 1.0))
    for axis in (1, 2) if swapped_stiffness else ():
        if draw(st.booleans()):
            low, high = f"k_low[{axis}]", f"k_high[{axis}]"
            values[low], values[high] = values[high], values[low]
    return values


def constants(
    values: Mapping[str, float],
) -> tuple[coefficients.Arm, tuple[coefficients.Joint, coefficients.Joint]]:
    """The constants of the equations of motion."""
    return coefficients.arm(values), (coefficients.joint(values, 1), coefficients.joint(values, 2))


def at_rest(values: Mapping[str, float], q_a: tuple[float, float]) -> np.ndarray:
    """Memory for ``integrator.advance``: in steady state at ``q_a`` [rad], the inputs holding it there."""
    arm, joints = constants(values)
    rest = equilibrium.solve(arm, joints, q_a)
    memory = np.zeros(integrator.STATE + integrator.STATE_SIZE)
    memory[0:2] = rest.u_m
    memory[6:12] = (*rest.q_m, *q_a, *kinematics.tcp(arm, *q_a))
    memory[integrator.STATE :] = integrator.state_at_rest(q_a, rest.q_m, arm, joints)
    return memory


def tcp_distance(memory: np.ndarray, X_0: np.ndarray) -> float:
    """Distance [m] of the tool centre point from ``X_0``."""
    return float(np.hypot(*(memory[10:12] - X_0)))
