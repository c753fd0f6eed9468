"""Runs the plant's FMU in plain FMPy, without this project: ``python -I plant_alone.py FOLDER EXPERIMENT [no-numba]``.

FOLDER is the extracted FMU; experiments are the functions below. The arguments of one come as JSON through standard
input, its result goes as JSON to standard output.
"""

import ctypes
import json
import math
import os
import sys

BLOCKED = {"orchestrator", "plant_fmu", "controller_fmu", "build_fmus"}
if "no-numba" in sys.argv:
    BLOCKED.add("numba")


class Blocker:
    """Makes top-level modules unimportable."""

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in BLOCKED:
            raise ImportError(f"{name} is blocked")


sys.meta_path.insert(0, Blocker())

from fmpy import read_model_description  # noqa: E402
from fmpy.fmi1 import FMICallException  # noqa: E402
from fmpy.simulation import instantiate_fmu  # noqa: E402

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


EXCITATION = {"u_m[1]": 20.0, "u_m[2]": 10.0, "u_d[1]": 1.0, "u_d[2]": 1.0, "F[1]": 300.0, "F[2]": 300.0}
"""Amplitudes of inputs that move everything."""


class Plant:
    """An instance whose variables go by name; to be used in a with statement."""

    def __init__(self, parameters=None):
        self.fmu = instantiate_fmu(FOLDER, DESCRIPTION, "CoSimulation", debug_logging=True, logger=keep)
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


def trajectory(parameters, samples):
    """Outputs under excitation."""
    with Plant(parameters) as plant:
        return plant.run(0, samples), "numba" in sys.modules


def state(parameters, samples):
    """Outputs after a saved state: straight on, again from the state, in another instance from its bytes, and those of
    the very beginning, before and after a reset."""
    with Plant(parameters) as plant:
        first = plant.run(0, samples)
        kept = plant.fmu.getFMUstate()
        as_bytes = plant.fmu.serializeFMUstate(kept)
        straight_on = plant.run(samples, 2 * samples)
        plant.fmu.setFMUstate(kept)
        now = plant.get(*OUTPUTS)
        again = plant.run(samples, 2 * samples)
        plant.fmu.freeFMUstate(kept)
        plant.fmu.reset()
        plant.initialize()
        afresh = plant.run(0, samples)
    with Plant({"q_a_start[1]": 1.0}) as other:
        other.fmu.setFMUstate(other.fmu.deSerializeFMUstate(as_bytes))
        return straight_on, now, again, other.run(samples, 2 * samples), first, afresh


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
