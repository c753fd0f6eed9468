"""The PID in continuous time from CasADi: FMI 3.0 Model Exchange without any sampling.

The derivative filter has the pole of the discrete one, exp(-T_s / tau) = z_p:

    tau dx/dt = e - x,    u = u_m0 + K_p e + K_i int e dt + K_d (e - x) / tau

Torques differ from the discrete controller's; ``held`` gives them exactly for an error that is held over each step.
"""

from __future__ import annotations

import json
import math
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from pid_fmus import AXES, GAINS, T_S

from controller_fmu.export.c_fmu import FMI_HEADERS

from .recipe import Recipe, Timing

EXPORT = Path(__file__).parent / "sources" / "casadi_export.py"

TAU = tuple(-T_S / math.log(z_p) for z_p in GAINS["z_p"])
"""Time constant of the derivative filter of each axis [s]."""


def held(errors: Sequence[Sequence[float]], u_m0: Sequence[float]) -> list[tuple[float, ...]]:
    """Return the torques [N.m] at the end of each step of T_s over which an error [rad] was held."""
    filtered, integral = [0.0] * AXES, [0.0] * AXES
    torques = []
    for error in errors:
        row = []
        for i, e in enumerate(error):
            filtered[i] = e + (filtered[i] - e) * GAINS["z_p"][i]
            integral[i] += e * T_S
            proportional_integral = u_m0[i] + GAINS["K_p"][i] * e + GAINS["K_i"][i] * integral[i]
            row.append(proportional_integral + GAINS["K_d"][i] * (e - filtered[i]) / TAU[i])
        torques.append(tuple(row))
    return torques


def _make(target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        # CasADi writes its files into the working folder: a process of its own has one of its own.
        settings = json.dumps({**GAINS, "tau": TAU, "T_s": T_S, "include": str(FMI_HEADERS)})
        command = [sys.executable, "-B", str(EXPORT), settings]
        subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
        return Path(folder, "ContinuousPID.fmu").replace(target)


RECIPES = (Recipe("casadi", _make, modules=("casadi",), needs_compiler=True, timing=Timing.CONTINUOUS),)
