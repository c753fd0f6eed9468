"""Model descriptions of controllers, made by hand: what binding, units and sample times look at, without any file."""

from collections.abc import Iterable, Sequence
from fractions import Fraction
from pathlib import Path

from fmpy.model_description import CoSimulation, DefaultExperiment, ModelDescription, ModelVariable, Unit

from orchestrator.fmi.archive import Archive

T_S = Fraction(1, 4000)


def variable(
    name: str, causality: str = "input", unit: str | None = None, kind: str = "Real", size: int = 1, **others: str
) -> ModelVariable:
    """A variable of an FMU."""
    shape = (size,) if size > 1 else ()
    return ModelVariable(name, 0, kind, causality=causality, variability="continuous", unit=unit, shape=shape, **others)


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
    exact = [*pair(["q_m[1]", "q_m[2]"], "input", "rad"), *pair(["u_m[1]", "u_m[2]"], "output", "N.m")]
    return description([*(one for one in exact if not one.name.startswith(f"{without}[")), *further])


def archive(fixed: str | None = None, experiment: str | None = None) -> Archive:
    """An archive that declares these step sizes [s] and has no file."""
    shown = ModelDescription(
        fmiVersion="3.0",
        coSimulation=CoSimulation(modelIdentifier="x", fixedInternalStepSize=fixed),
        defaultExperiment=DefaultExperiment(stepSize=experiment) if experiment else None,
    )
    return Archive(Path("x.fmu"), "", Path("."), shown, "CoSimulation")
