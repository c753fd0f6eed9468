"""The scheduled LQG controller with a dither against friction, as an FMI 2.0 co-simulation slave.

The slave is that of controller_fmu/lqg with weights of its own. To its torque comes the dither of
flexible_manipulator_dither.py, which the filter's own estimate of the TCP error switches on. The filter is told the
sum, limited as the drive limits it, and so takes no dither for a disturbance.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar

from flexible_manipulator_dither import Dither, Wave, dither, wave
from flexible_manipulator_lqg.interface import BASE_UNITS, chosen, parameters
from manipulator_lqg_fmu import ROWS, U_M, ManipulatorLQG, U

__all__ = ["BASE_UNITS", "UNITS", "DitheredLQG"]

OWN_ROWS = (*ROWS, *parameters(Dither))
UNITS = {row.name: row.unit for row in OWN_ROWS}
"""Unit of every variable, by its name without index; the build writes them into the model description."""

TORQUE_LIMIT = (35.0, 20.0)
"""u_max of Table 1 [N.m]."""


class DitheredLQG(ManipulatorLQG):
    """The slave; see its base class."""

    description = "LQG controller with a dither that keeps friction from holding the motors while the arm rings"
    data: ClassVar[Path] = Path(__file__).with_name("friction_weights.json")
    rows = OWN_ROWS

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._wave: Wave | None = None
        self._level = 0.0

    def _design(self, values: Mapping[str, float]) -> None:
        super()._design(values)
        self._wave = wave(chosen(Dither, values), values["T_s"])

    def _sample(self, current_time: float) -> bool:
        if not super()._sample(current_time):
            return False
        vector, x = self._now, self._values
        error = math.hypot(vector.item(U + 2), vector.item(U + 3))
        self._level, *shake = dither(self._wave, self._level, error, self._samples)
        for i, u_max in enumerate(TORQUE_LIMIT):
            x[U_M + i] = torque = min(max(x[U_M + i] + shake[i], -u_max), u_max)
            vector[U + i] = torque - self._u_0[i]
        return True

    def _get_fmu_state(self) -> dict[str, Any]:
        return {**super()._get_fmu_state(), "wave": self._wave, "level": self._level}

    def _set_fmu_state(self, state: dict[str, Any]) -> None:
        super()._set_fmu_state(state)
        self._wave = state["wave"] and Wave(*state["wave"])
        self._level = state["level"]
