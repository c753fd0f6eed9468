"""The PID in continuous time from CasADi: FMI 3.0 Model Exchange without any sampling.

The derivative filter has the pole of the discrete one, exp(-T_s / tau) = z_p:

    tau dx/dt = e - x,    u = u_m0 + K_p e + K_i int e dt + K_d (e - x) / tau

Torques differ from the discrete controller's; ``held`` gives them exactly for an error that is held over each step.
"""

import json
import shlex
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from support.pid_fmus import GAINS, T_S

from controller_fmu.export.c_fmu import FMI_HEADERS
from controller_fmu.export.compiler import require_compiler

from .recipe import Recipe

EXPORT = Path(__file__).parent / "sources" / "casadi_export.py"
K_P, K_I, K_D, Z_P = (np.array(GAINS[name]) for name in ("K_p", "K_i", "K_d", "z_p"))
TAU = -T_S / np.log(Z_P)
"""Time constant of the derivative filter of each axis [s]."""


def held(errors: np.ndarray, u_m0: Sequence[float]) -> np.ndarray:
    """Return the torques [N.m] at the end of each step of T_s over which an error [rad] was held, shape (steps, 2)."""
    filtered, torques = np.zeros(2), []
    for e, integral in zip(errors, T_S * np.cumsum(errors, axis=0), strict=True):
        filtered = e + (filtered - e) * Z_P
        torques.append(u_m0 + K_P * e + K_I * integral + K_D * (e - filtered) / TAU)
    return np.array(torques)


def _make(target: Path) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        # CasADi writes its files into the working folder: a process of its own has one of its own.
        tools = {"include": str(FMI_HEADERS), "compiler": shlex.join(require_compiler())}
        settings = json.dumps({**GAINS, "tau": TAU.tolist(), "T_s": T_S, **tools})
        command = [sys.executable, "-B", str(EXPORT), settings]
        subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
        return Path(folder, "ContinuousPID.fmu").replace(target)


RECIPES = (Recipe("casadi", _make, needs=("casadi", "compiler")),)
