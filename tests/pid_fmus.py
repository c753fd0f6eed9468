"""Drive PID controller FMUs in child processes, and the law to hold them against.

Python FMUs share the interpreter they are loaded into: no test process ever loads one itself.
"""

from __future__ import annotations

import multiprocessing
import tempfile
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from ctypes import byref
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import fmpy
import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import (
    FMU2Slave,
    defaultCallbacks,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy

from orchestrator.cosim.slaves.log import forget_exception

T_S = 0.25e-3
AXES = 2
GAINS = {"K_p": (45.0, 15.0), "K_i": (30.0, 10.0), "K_d": (1.5, 0.5), "z_p": (0.95, 0.95)}
INPUTS = ("q_m_ref[1]", "q_m_ref[2]", "q_m[1]", "q_m[2]")
OUTPUTS = ("u_m[1]", "u_m[2]")


@dataclass(frozen=True)
class Signals:
    """References and measurements, one row a sample, and the torques to start from."""

    q_m_ref: np.ndarray
    """Shape (samples, 2), rad."""
    q_m: np.ndarray
    """Shape (samples, 2), rad."""
    u_m0: tuple[float, float]
    """N.m."""

    @property
    def rows(self) -> list[tuple[float, ...]]:
        """The inputs of every sample in the order of INPUTS."""
        return [tuple(row) for row in np.hstack([self.q_m_ref, self.q_m]).tolist()]


def random_signals(samples: int = 200, seed: int = 1) -> Signals:
    """Signals without any structure: if torques agree on these to the last bit, the laws are the same."""
    generator = np.random.default_rng(seed)
    return Signals(
        q_m_ref=generator.normal(size=(samples, AXES)),
        q_m=generator.normal(size=(samples, AXES)),
        u_m0=(1.7, -0.3),
    )


def law(signals: Signals) -> list[tuple[float, float]]:
    """Torques [N.m] of the recursion for eq. (13), written as plainly as can be."""
    axes = []
    for i in range(AXES):
        K_p, K_i, K_d, z_p = (GAINS[name][i] for name in ("K_p", "K_i", "K_d", "z_p"))
        e_1, v, s = 0.0, 0.0, signals.u_m0[i]
        torques = []
        for reference, measured in zip(signals.q_m_ref[:, i].tolist(), signals.q_m[:, i].tolist(), strict=True):
            e = reference - measured
            v = z_p * v + (1.0 - z_p) * (e - e_1) / T_S
            s = s + K_i * T_S * e
            torques.append(K_p * e + K_d * v + s)
            e_1 = e
        axes.append(torques)
    return list(zip(*axes, strict=True))


@dataclass
class Slave:
    """An FMI 2.0 co-simulation instance whose variables go by name, and what it logged."""

    fmu: FMU2Slave
    references: dict[str, int]
    log: list[str] = field(default_factory=list)

    def set(self, names: Sequence[str], values: Sequence[float]) -> None:
        """Set variables by name."""
        self.fmu.setReal([self.references[name] for name in names], list(values))

    def get(self, names: Sequence[str] = OUTPUTS) -> tuple[float, ...]:
        """Get variables by name."""
        return tuple(self.fmu.getReal([self.references[name] for name in names]))

    def initialize(self, u_m0: Sequence[float] = (0.0, 0.0)) -> None:
        """Go through initialization."""
        self.fmu.setupExperiment(startTime=0.0)
        self.fmu.enterInitializationMode()
        self.set(("u_m0[1]", "u_m0[2]"), u_m0)
        self.fmu.exitInitializationMode()

    def run(self, rows: Sequence[Sequence[float]], first: int = 0) -> list[tuple[float, ...]]:
        """Do a step per row of inputs, the first of them number ``first``; return the torques after each."""
        torques = []
        for k, row in enumerate(rows, start=first):
            self.set(INPUTS, row)
            self.fmu.doStep(k * T_S, T_S)
            torques.append(self.get())
        return torques


def instance_arguments(path: Path) -> dict[str, str]:
    """What FMPy's classes want to know to load an FMU."""
    description = read_model_description(str(path))
    # A folder of its own, as a loaded library must not be overwritten; beside the FMU, where pytest cleans up.
    folder = extract(str(path), unzipdir=tempfile.mkdtemp(dir=path.parent))
    # FMI 3 names platforms in another way, which FMPy's classes do not know by themselves.
    platform = fmpy.platform_tuple if description.fmiVersion.startswith("3") else fmpy.platform
    interface = description.coSimulation or description.modelExchange
    library = Path(folder, "binaries", platform, interface.modelIdentifier + fmpy.sharedLibraryExtension)
    return {
        "guid": description.guid,
        "modelIdentifier": interface.modelIdentifier,
        "unzipDirectory": folder,
        "libraryPath": str(library),
        "instanceName": "controller",
    }


@contextmanager
def slave(path: Path) -> Iterator[Slave]:
    """Instantiate the FMI 2.0 co-simulation FMU ``path``."""
    variables = read_model_description(str(path)).modelVariables
    fmu = FMU2Slave(**instance_arguments(path))
    opened = Slave(fmu, {variable.name: variable.valueReference for variable in variables})
    callbacks = fmi2CallbackFunctions()

    def keep(*arguments):
        forget_exception()
        opened.log.append(arguments[-1].decode())

    callbacks.logger = fmi2CallbackLoggerTYPE(keep)
    callbacks.allocateMemory = defaultCallbacks.allocateMemory
    callbacks.freeMemory = defaultCallbacks.freeMemory
    addLoggerProxy(byref(callbacks))
    fmu.instantiate(callbacks=callbacks, loggingOn=True)
    try:
        yield opened
    finally:
        fmu.freeInstance()


def in_child(function: Callable[..., Any], *arguments: Any) -> Any:
    """Return what ``function`` returns in a fresh process."""
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(max_workers=1, mp_context=context) as pool:
        return pool.submit(function, *arguments).result(timeout=120)
