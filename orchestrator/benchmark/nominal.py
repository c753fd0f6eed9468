"""The manipulator's nominal parameters, and changes of them."""

from __future__ import annotations

import math
from collections.abc import Mapping

from plant_fmu.flexible_manipulator.parameters import NOMINAL, check

from ..errors import InputError
from .stiffness import require_integrable


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
