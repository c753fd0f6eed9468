"""Runs the plant's FMU in plain FMPy, without this project: ``python -I plant_alone.py FOLDER EXPERIMENT [no-numba]``.

FOLDER is the extracted FMU; experiments are the functions below. The arguments of one come as JSON through standard
input, its result goes as JSON to standard output.
"""

from __future__ import annotations

import ctypes
import json
import math
import os
import sys
from ctypes import byref

BLOCKED = {"orchestrator", "plant_fmu", "controller_fmu", "build_fmus"}
if "no-numba" in sys.argv:
    BLOCKED.add("numba")


class Blocker:
    """Makes top-level modules unimportable."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ImportError(f"{name} is blocked")


sys.meta_path.insert(0, Blocker())

from fmpy import calloc, free, read_model_description  # noqa: E402
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.fmi2 import (  # noqa: E402
    FMU2Slave,
    fmi2CallbackAllocateMemoryTYPE,
    fmi2CallbackFreeMemoryTYPE,
    fmi2CallbackFunctions,
    fmi2CallbackLoggerTYPE,
)
from fmpy.logging import addLoggerProxy  # noqa: E402

FOLDER = sys.argv[1]
DESCRIPTION = read_model_description(FOLDER)
REFERENCES = {variable.name: variable.valueReference for variable in DESCRIPTION.modelVariables}
STEP = 0.25e-3
OUTPUTS = ("q_m[1]", "q_m[2]", "q_a[1]", "q_a[2]", "X[1]", "X[2]")
MESSAGES: list[str] = []

FORGET_EXCEPTION = ctypes.pythonapi.PyErr_Clear
FORGET_EXCEPTION.restype = None


def keep(*arguments):
    """Keep a message. pythonfmu sends it while its slave's exception is pending, in which calls of C code fail."""
    FORGET_EXCEPTION()
    MESSAGES.append(arguments[-1].decode())


CALLBACKS = fmi2CallbackFunctions()
CALLBACKS.logger = fmi2CallbackLoggerTYPE(keep)
CALLBACKS.allocateMemory = fmi2CallbackAllocateMemoryTYPE(calloc)
CALLBACKS.freeMemory = fmi2CallbackFreeMemoryTYPE(free)
addLoggerProxy(byref(CALLBACKS))


EXCITATION = {"u_m[1]": 20.0, "u_m[2]": 10.0, "u_d[1]": 1.0, "u_d[2]": 1.0, "F[1]": 300.0, "F[2]": 300.0}
"""Amplitudes of inputs that move everything."""


class Plant:
    """An instance whose variables go by name; to be used in a with statement."""

    def __init__(self, parameters=None):
        self.fmu = FMU2Slave(
            guid=DESCRIPTION.guid,
            modelIdentifier=DESCRIPTION.coSimulation.modelIdentifier,
            unzipDirectory=FOLDER,
        )
        self.fmu.instantiate(callbacks=CALLBACKS, loggingOn=True)
        self.parameters = parameters or {}

    def __enter__(self):
        try:
            self.initialize()
        except FMICallException:
            self.fmu.freeInstance()
            raise
        return self

    def __exit__(self, *_):
        self.fmu.freeInstance()

    def initialize(self):
        self.fmu.setupExperiment(startTime=0.0)
        self.set(self.parameters)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()

    def set(self, values):
        if values:
            self.fmu.setReal([REFERENCES[name] for name in values], list(values.values()))

    def get(self, *names):
        return list(self.fmu.getReal([REFERENCES[name] for name in names]))

    def hold(self):
        """Command the torque of the steady state."""
        self.set(dict(zip(("u_m[1]", "u_m[2]"), self.get("u_m0[1]", "u_m0[2]"), strict=True)))

    def excite(self, k):
        """Inputs of sample ``k``, without structure."""
        self.set({name: size * math.sin(1.0 + 0.37 * k * (i + 1)) for i, (name, size) in enumerate(EXCITATION.items())})

    def run(self, first, last):
        """Outputs after each sample from ``first`` until before ``last``."""
        rows = []
        for k in range(first, last):
            self.excite(k)
            self.fmu.doStep(k * STEP, STEP)
            rows.append(self.get(*OUTPUTS))
        return rows


def published(parameters):
    """Start values of all outputs and calculated parameters, and which modules of the project there are."""
    names = [v.name for v in DESCRIPTION.modelVariables if v.causality in ("output", "calculatedParameter")]
    with Plant(parameters) as plant:
        return dict(zip(names, plant.get(*names), strict=True)), sorted(BLOCKED & set(sys.modules))


def rest(systems, seconds):
    """Farthest distance of the tool from its start for each system, the steady state's torque held."""
    distances = []
    for parameters in systems:
        farthest = 0.0
        with Plant(parameters) as plant:
            plant.hold()
            x_0, z_0 = plant.get("X[1]", "X[2]")
            for k in range(round(seconds / STEP)):
                plant.fmu.doStep(k * STEP, STEP)
                x, z = plant.get("X[1]", "X[2]")
                farthest = max(farthest, math.hypot(x - x_0, z - z_0))
        distances.append(farthest)
    return distances


def trajectory(parameters, samples):
    """Outputs under excitation."""
    with Plant(parameters) as plant:
        return plant.run(0, samples), "numba" in sys.modules


def partition(parameters, steps):
    """Outputs after each of ``steps`` [s] of different sizes, under excitation."""
    rows, time = [], 0.0
    with Plant(parameters) as plant:
        for k, step in enumerate(steps):
            plant.excite(k)
            plant.fmu.doStep(time, step)
            rows.append(plant.get(*OUTPUTS))
            time += step
    return rows


def state(parameters, samples):
    """Outputs after a saved state: straight on, again from the state, and in another instance from its bytes."""
    with Plant(parameters) as plant:
        plant.run(0, samples)
        kept = plant.fmu.getFMUstate()
        as_bytes = plant.fmu.serializeFMUstate(kept)
        straight_on = plant.run(samples, 2 * samples)
        plant.fmu.setFMUstate(kept)
        now = plant.get(*OUTPUTS)
        again = plant.run(samples, 2 * samples)
        plant.fmu.freeFMUstate(kept)
    with Plant({"q_a_start[1]": 1.0}) as other:
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(as_bytes))
        return straight_on, now, again, other.run(samples, 2 * samples)


def reset(parameters, samples):
    """Outputs of a first run, and of one after a reset."""
    with Plant(parameters) as plant:
        first = plant.run(0, samples)
        plant.fmu.reset()
        plant.initialize()
        return first, plant.run(0, samples)


def refusals(systems):
    """The FMI call in which each system is refused (None where it is not), and what was logged about it."""
    answers = []
    for parameters in systems:
        MESSAGES.clear()
        try:
            with Plant(parameters):
                answers.append((None, "\n".join(MESSAGES)))
        except FMICallException as error:
            answers.append((error.function, "\n".join(MESSAGES)))
    return answers


if __name__ == "__main__":
    print(json.dumps(globals()[sys.argv[2]](*json.load(sys.stdin))), flush=True)
    # pythonfmu 0.7.0 frees its interpreter's state twice while a process exits, which now and then aborts it.
    os._exit(0)
