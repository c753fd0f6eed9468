"""Model descriptions of controllers, made by hand: what binding, units and sample times look at, without any file."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

from fmpy.model_description import CoSimulation, DefaultExperiment, ModelDescription, ModelVariable, Unit

from orchestrator.cosim.archive import Archive

UNITS = {"u": "N.m", "q": "rad", "e": "rad"}
"""Unit of a variable by the first letter of its connector."""


def variable(
    name: str,
    causality: str = "input",
    unit: str | None = None,
    kind: str = "Real",
    size: int = 1,
    start: str | None = None,
) -> ModelVariable:
    """A variable of an FMU."""
    return ModelVariable(
        name=name,
        valueReference=0,
        type=kind,
        causality=causality,
        variability="continuous",
        unit=unit,
        start=start,
        shape=(size,) if size > 1 else (),
    )


def pair(names: Sequence[str], causality: str = "input", unit: str | None = None) -> list[ModelVariable]:
    """Scalars of one kind."""
    return [variable(name, causality, unit) for name in names]


def description(variables: Iterable[ModelVariable], units: Sequence[Unit] = ()) -> ModelDescription:
    """A model description with ``variables``, whose value references are their places."""
    listed = list(variables)
    for reference, one in enumerate(listed):
        one.valueReference = reference
    return ModelDescription(fmiVersion="2.0", modelVariables=listed, unitDefinitions=list(units))


def usual(*further: ModelVariable, without: str = "") -> ModelDescription:
    """The exact connectors q_m and u_m but ``without``, and ``further`` variables."""
    rows = {
        "q_m": pair(["q_m[1]", "q_m[2]"], "input", "rad"),
        "u_m": pair(["u_m[1]", "u_m[2]"], "output", "N.m"),
    }
    kept = [row for name, own in rows.items() if name != without for row in own]
    return description([*kept, *further])


def archive(fixed: str | None = None, experiment: str | None = None) -> Archive:
    """An archive that declares these step sizes [s] and has no file."""
    shown = ModelDescription(
        fmiVersion="3.0",
        coSimulation=CoSimulation(modelIdentifier="x", fixedInternalStepSize=fixed),
        defaultExperiment=DefaultExperiment(stepSize=experiment) if experiment else None,
    )
    return Archive(Path("x.fmu"), "", Path("."), shown, "CoSimulation")


T_S = Fraction(1, 4000)
