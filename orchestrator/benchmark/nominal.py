"""The manipulator's nominal parameters, changes of them, and whether the plant's integration, with fixed substeps, can
follow them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np

from plant_fmu.flexible_manipulator.coefficients import arm, joint, sticking
from plant_fmu.flexible_manipulator.parameters import NOMINAL, check

from ..errors import InputError
from .linearization import system_matrix

STIFF, DAMPED = ("k_low", "k_high"), ("d", "f_d", "f_c", "alpha")
"""Uncertain parameters whose upper end makes the manipulator's motion faster, and those whose upper end asks for
shorter substeps, but whose lower end lets a motion grow; of the others only the masses matter."""

MAX_SUBSTEPS = 100
"""Largest number of substeps in place of one, where friction is steep: a simulation takes as many times longer."""

MAX_GROWTH = 1.0 + 1e-6
"""Largest growth of a motion per substep: the rigid body's, which is 1, with rounding."""


def require_integrable(changes: Mapping[str, float], uncertainty: Mapping[str, float]) -> None:
    """Refuse manipulators that the plant's integration cannot follow.

    The equations of motion are linearized at rest, without gravity, where friction is steepest; Runge-Kutta's fourth
    order must not amplify any of their motions at the plant's own substep. This is done for the lightest and stiffest
    members of the uncertainty, the most and the least damped one, with gears bent or not and the second link in any
    direction.

    Parameters
    ----------
    changes : mapping
        Changed nominal parameters by FMI name, SI units; each within its physical range.
    uncertainty : mapping
        Half-widths of uncertain parameters relative to their nominal value, by symbol: a protocol's ``uncertainty``.

    Raises
    ------
    InputError
        ``bad-plant-parameter`` with the parameter that is to blame.
    """
    if _is_integrable({**NOMINAL, **changes}, uncertainty):
        return
    # The message names the one change without which it would work, or else the first.
    curing = [name for name in changes if _is_integrable({**NOMINAL, **changes, name: NOMINAL[name]}, uncertainty)]
    name = (curing or list(changes))[0]
    raise InputError(
        f"With the plant's {name} = {changes[name]:g}, the integration is unstable: the motions are too fast for its "
        "step, or a coefficient of the equations of motion is not a finite number.",
        "bad-plant-parameter",
        name,
        changes[name],
    )


def _is_integrable(nominal: Mapping[str, float], uncertainty: Mapping[str, float]) -> bool:
    signs = dict.fromkeys(STIFF, 1.0)
    members = (signs | dict.fromkeys(DAMPED, damping) for damping in (1.0, -1.0))
    return all(_is_followed(_member(nominal, uncertainty, signs)) for signs in members)


def _member(
    nominal: Mapping[str, float], uncertainty: Mapping[str, float], signs: Mapping[str, float]
) -> dict[str, float]:
    """The parameters at the ends of their ranges: at the lower one unless ``signs`` say otherwise."""
    return {
        name: value * (1.0 + signs.get(symbol := name.partition("[")[0], -1.0) * uncertainty.get(symbol, 0.0))
        for name, value in nominal.items()
    }


def _is_followed(member: Mapping[str, float]) -> bool:
    from plant_fmu.flexible_manipulator.integrator import MAX_SUBSTEP, longest_substep  # loads Numba

    try:
        links, joints = arm(member), (joint(member, 1), joint(member, 2))
        coefficients = np.array([*links, *joints[0], *joints[1]])
        brakes = [sticking(actuator) for actuator in joints]
        substep = longest_substep(links, joints)
        if not np.all(np.isfinite(coefficients)) or substep * MAX_SUBSTEPS < MAX_SUBSTEP:
            return False
        # Overflows are expected here, and show in the growth.
        with np.errstate(all="ignore"):
            return all(
                _growth(substep * system_matrix(links, joints, stiffness, brakes, s_2)) <= MAX_GROWTH
                for stiffness in ([actuator.k_1 for actuator in joints], [actuator.m_1 for actuator in joints])
                for s_2 in (-1.0, 0.0, 1.0)
            )
    except (ArithmeticError, np.linalg.LinAlgError):
        return False


def _growth(scaled: np.ndarray) -> float:
    """Largest factor by which a Runge-Kutta step amplifies a motion; ``scaled`` is the step times the system matrix."""
    z = np.linalg.eigvals(scaled)
    # The stability function of the classical Runge-Kutta method, 1 + z + z^2/2 + z^3/6 + z^4/24.
    growth = float(np.max(np.abs(1.0 + z * (1.0 + z / 2.0 * (1.0 + z / 3.0 * (1.0 + z / 4.0))))))
    # Comparisons with NaN are false, and would let it pass.
    return growth if not math.isnan(growth) else math.inf


def check_changes(changes: Mapping[str, float], uncertainty: Mapping[str, float]) -> None:
    """Refuse changed nominal parameters (FMI names, SI units) that no manipulator has, or that the plant's integration
    cannot follow over the ``uncertainty``, a protocol's relative half-widths.

    Raises :class:`InputError` with the parameter's name.
    """
    for name, value in changes.items():
        if name not in NOMINAL:
            raise InputError(
                f"The plant has no nominal parameter {name}. It has: {', '.join(NOMINAL)}. Its link angles are those "
                "of the configuration.",
                "no-plant-parameter",
                "plant",
                name,
                NOMINAL,
            )
        if not math.isfinite(value):
            raise InputError(f"The plant's {name}, {value}, is not a finite number.", "not-finite", name, value)
    try:
        check({**NOMINAL, **changes})
    except ValueError as problem:
        raise InputError(f"The plant's {problem}.", "bad-plant-parameter", "plant") from None
    if changes:
        require_integrable(changes, uncertainty)
