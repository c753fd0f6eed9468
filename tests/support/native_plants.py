"""The native plant in the test's own process: it is plain C, which nothing else here can disturb."""

import tempfile
from collections.abc import Mapping, Sequence
from ctypes import c_double
from pathlib import Path

import numpy as np
from fmpy import extract, read_model_description
from fmpy.fmi2 import FMU2Model, FMU2Slave

from plant_fmu.native.interface import STATES

INPUTS = ("u_m[1]", "u_m[2]", "u_d[1]", "u_d[2]", "F[1]", "F[2]")


class NativePlant:
    """An instance of an FMI 2.0 FMU of the native plant, for co-simulation or Model Exchange."""

    def __init__(self, path: Path) -> None:
        description = read_model_description(str(path))
        interface = description.coSimulation or description.modelExchange
        self.references = {variable.name: variable.valueReference for variable in description.modelVariables}
        # A folder of its own, as a loaded library must not be overwritten; beside the FMU, where pytest cleans up.
        self.fmu = (FMU2Slave if description.coSimulation else FMU2Model)(
            guid=description.guid,
            modelIdentifier=interface.modelIdentifier,
            unzipDirectory=extract(str(path), unzipdir=tempfile.mkdtemp(dir=path.parent)),
        )
        self.fmu.instantiate()
        self.time = 0.0

    def initialize(self, values: Mapping[str, float]) -> None:
        """From wherever it is to the steady state of these parameters."""
        self.fmu.reset()
        self.fmu.setupExperiment(startTime=0.0)
        self.set(values)
        self.fmu.enterInitializationMode()
        self.fmu.exitInitializationMode()
        if isinstance(self.fmu, FMU2Model):
            self.fmu.newDiscreteStates()
            self.fmu.enterContinuousTimeMode()
        self.time = 0.0

    def set(self, values: Mapping[str, float]) -> None:
        """Set variables by name."""
        self.fmu.setReal([self.references[name] for name in values], list(values.values()))

    def get(self, *names: str) -> list[float]:
        """Get variables by name."""
        return list(self.fmu.getReal([self.references[name] for name in names]))

    def step(self, inputs: Sequence[float], size: float) -> None:
        """A step of co-simulation of ``size`` [s] with the inputs in the order of INPUTS."""
        self.set(dict(zip(INPUTS, inputs, strict=True)))
        self.fmu.doStep(self.time, size)
        self.time += size

    def derivative(self, x: Sequence[float], inputs: Sequence[float]) -> np.ndarray:
        """Model Exchange: the derivatives of the states ``x``, both in the order of STATES."""
        self.set(dict(zip(INPUTS, inputs, strict=True)))
        states, derivatives = (c_double * len(STATES))(*x), (c_double * len(STATES))()
        self.fmu.setContinuousStates(states, len(states))
        self.fmu.getDerivatives(derivatives, len(derivatives))
        return np.array(derivatives)
