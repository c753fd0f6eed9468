"""Reference trajectories: what an FMU answers to given inputs, in files that other tools read.

Row k of the inputs is set before the step from t_k to t_(k+1); row k of the outputs is what the FMU has at t_k, row 0
after initialization. Inputs are triangular waves, made by operations that give the same bits on all platforms.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path

import fmpy
from fmpy.fmi2 import FMU2Slave
from fmpy.model_description import ModelDescription, ModelVariable

STEPS = 2000
"""Steps of DefaultExperiment's length; in all FMUs of the benchmark half a second or less."""

AMPLITUDES: Mapping[str, float] = {"rad": 2.0**-6, "N.m": 4.0, "N": 32.0}
"""Of the waves, by unit."""

CONSTANT = ("q_m_ref", "u_m0", "q_a_ref")
"""Inputs that are given once and hold during a simulation."""

QUARTER = 50
"""Quarter of the period of the first input's wave in steps; the others' are multiples of it."""


def reference(fmu: Path) -> tuple[str, str]:
    """Inputs and outputs of ``fmu``, FMI 2.0 co-simulation with a binary for this machine, as the text of CSV files.

    The wave of a torque ``u_m`` is about ``u_m0``, where the FMU has that as a calculated parameter: it holds the arm.
    """
    described = fmpy.read_model_description(str(fmu))
    inputs, outputs = (
        [variable for variable in described.modelVariables if variable.causality == causality]
        for causality in ("input", "output")
    )
    step = float(described.defaultExperiment.stepSize)
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        fmpy.extract(str(fmu), folder)
        centres = _centres(described, inputs, folder)
        given = [[_wave(variable, i, k, centres[i]) for i, variable in enumerate(inputs)] for k in range(STEPS + 1)]
        answers = _simulated(described, folder, inputs, outputs, given, step)
    times = [k * step for k in range(STEPS + 1)]
    return _table(inputs, times, given), _table(outputs, times, answers)


def _centres(described: ModelDescription, inputs: Sequence[ModelVariable], folder: str) -> list[float]:
    """What each input's wave is about: its start value, or the torque at rest."""
    at_rest = {
        variable.name.replace("u_m0", "u_m"): variable.valueReference
        for variable in described.modelVariables
        if variable.causality == "calculatedParameter" and variable.name.startswith("u_m0")
    }
    with _initialized(described, folder, [], []) as slave:
        torques = dict(zip(at_rest, slave.getReal(list(at_rest.values())), strict=True))
    return [torques.get(variable.name, float(variable.start)) for variable in inputs]


def _wave(variable: ModelVariable, index: int, k: int, centre: float) -> float:
    """The input number ``index`` at step ``k``: a triangle that begins at its centre."""
    if variable.name.partition("[")[0] in CONSTANT:
        return centre
    quarter = QUARTER * (index + 1)
    phase = k % (4 * quarter) / quarter
    height = phase if phase < 1 else 2 - phase if phase < 3 else phase - 4
    return centre + AMPLITUDES[variable.unit] * height


def _simulated(
    described: ModelDescription,
    folder: str,
    inputs: Sequence[ModelVariable],
    outputs: Sequence[ModelVariable],
    given: Sequence[Sequence[float]],
    step: float,
) -> list[list[float]]:
    references, output_references = ([variable.valueReference for variable in side] for side in (inputs, outputs))
    with _initialized(described, folder, references, given[0]) as slave:
        answers = [slave.getReal(output_references)]
        for k, values in enumerate(given[:-1]):
            slave.setReal(references, list(values))
            slave.doStep(currentCommunicationPoint=k * step, communicationStepSize=step)
            answers.append(slave.getReal(output_references))
    return answers


@contextmanager
def _initialized(
    described: ModelDescription, folder: str, references: Sequence[int], values: Sequence[float]
) -> Iterator[FMU2Slave]:
    """An instance after initialization with these inputs."""
    identifier = described.coSimulation.modelIdentifier
    slave = FMU2Slave(guid=described.guid, modelIdentifier=identifier, unzipDirectory=folder)
    slave.instantiate()
    try:
        slave.setupExperiment(startTime=0.0)
        slave.enterInitializationMode()
        if references:
            slave.setReal(list(references), list(values))
        slave.exitInitializationMode()
        yield slave
        slave.terminate()
    finally:
        slave.freeInstance()


def _table(variables: Sequence[ModelVariable], times: Sequence[float], rows: Sequence[Sequence[float]]) -> str:
    """A CSV file with the shortest digits that give the same numbers when they are read."""
    head = ",".join(f'"{name}"' for name in ("time", *(variable.name for variable in variables)))
    lines = (",".join(map(repr, (time, *row))) for time, row in zip(times, rows, strict=True))
    return "\n".join((head, *lines, ""))
