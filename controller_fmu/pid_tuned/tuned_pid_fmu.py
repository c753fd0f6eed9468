"""The benchmark's PID, eq. (12)-(13), with gains that an optimiser found: the start values of its parameters.

Law and slave are those of controller_fmu/pid; the gains stand in tuned_pid_gains.json, which tune.py writes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from diagonal_pid_fmu import UNITS, DiagonalPID

__all__ = ["UNITS", "TunedPID"]

GAINS = Path(__file__).with_name("tuned_pid_gains.json")


class TunedPID(DiagonalPID):
    """The slave; see its base class."""

    description = "Diagonal discrete-time PID controller, eq. (12)-(13) of the benchmark, with optimised gains"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        gains = json.loads(GAINS.read_text(encoding="utf-8"))["parameters"]
        for reference, variable in self.vars.items():
            self._values[reference] = gains.get(variable.name, self._values[reference])
