"""What every exporter's recipe says of itself: how to build its FMU, what that needs, and what to expect of it."""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

from controller_fmu.export import find_compiler


class Timing(Enum):
    """Which samples of the error e_0, e_1, ... a discrete controller has taken when doStep k returns.

    The value is the sentence for a report.
    """

    STEP_START = "samples at the start of each step: e_0 to e_k"
    INITIALIZATION = "samples at initialization, then at the end of each step: the initial error, then e_0 to e_k"
    TWICE_FIRST = "samples twice in the first step: e_0, then e_0 to e_k"
    CONTINUOUS = "has no samples: a continuous controller"


@dataclass(frozen=True)
class Ports:
    """Names of an FMU's variables for both axes; one name stands for an array of two."""

    q_m_ref: tuple[str, ...] = ("q_m_ref[1]", "q_m_ref[2]")
    q_m: tuple[str, ...] = ("q_m[1]", "q_m[2]")
    u_m: tuple[str, ...] = ("u_m[1]", "u_m[2]")
    u_m0: tuple[str, ...] = ("u_m0[1]", "u_m0[2]")


ARRAYS = Ports(("q_m_ref",), ("q_m",), ("u_m",), ("u_m0",))
"""FMI 3.0 arrays."""


@dataclass(frozen=True)
class Recipe:
    """One way to make the benchmark's two-axis PID, eq. (12)-(13), with default gains."""

    name: str
    """Also the stem of the FMU's file."""
    make: Callable[[Path], Path]
    """Writes the FMU to a path and returns it."""
    modules: tuple[str, ...] = ()
    """Python modules of the exporter."""
    needs_compiler: bool = False
    timing: Timing = Timing.STEP_START
    ports: Ports = Ports()
    angle_unit: float = 1.0
    """Unit of its angles [rad]."""
    torque_unit: float = 1.0
    """Unit of its torques [N.m]."""
    tolerance: float = 0.0
    """How far torques may be from the law's, relative to the greatest of them; 0 where the arithmetic is the same."""
    refused: str = ""
    """Why the benchmark must refuse it, if it must."""

    def missing(self) -> str | None:
        """Return why the FMU cannot be built here, or None if it can."""
        absent = [module for module in self.modules if importlib.util.find_spec(module) is None]
        if absent:
            return f"{self.name}: {', '.join(absent)} not installed (pip install '.[exporters]')"
        if self.needs_compiler and find_compiler() is None:
            return f"{self.name}: no C compiler"
        return None

    def build(self, folder: Path) -> Path:
        """Return ``folder/name.fmu``, made unless it is there."""
        path = folder / f"{self.name}.fmu"
        return path if path.exists() else self.make(path)
