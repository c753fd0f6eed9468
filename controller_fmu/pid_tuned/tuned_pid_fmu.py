"""The benchmark's PID, eq. (12)-(13), with gains that an optimiser found: the start values of its parameters.

Law and slave are those of controller_fmu/pid; the gains stand in tuned_pid_gains.json, which tune.py writes.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from diagonal_pid_fmu import K_D, K_I, K_P, UNITS, Z_P, DiagonalPID

__all__ = ["UNITS", "TunedPID"]

GAINS = Path(__file__).with_name("tuned_pid_gains.json")
PLACES = {"K_p": K_P, "K_i": K_I, "K_d": K_D, "z_p": Z_P}
"""Value reference of each gain's first element."""


class TunedPID(DiagonalPID):
    """The slave; see its base class."""

    description = "Diagonal discrete-time PID controller, eq. (12)-(13) of the benchmark, with optimised gains"

    def __init__(self, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        gains = json.loads(GAINS.read_text(encoding="utf-8"))["gains"]
        for name, place in PLACES.items():
            self._values[place : place + 2] = gains[name]
