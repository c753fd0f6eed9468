"""The connectors of plant and controller, and which of an FMU's variables they are bound to."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from fmpy.model_description import ModelDescription, ScalarVariable

from ..errors import InputError


@dataclass(frozen=True)
class Connector:
    """A pair of real variables, ``name[1]`` and ``name[2]``, with the unit the master uses for it."""

    name: str
    causalities: tuple[str, ...]
    unit: str
    required: bool = True

    def components(self) -> tuple[str, str]:
        """FMI names of the two components."""
        return f"{self.name}[1]", f"{self.name}[2]"


PLANT: tuple[Connector, ...] = (
    Connector("u_m", ("input",), "N.m"),
    Connector("u_d", ("input",), "N.m"),
    Connector("F", ("input",), "N"),
    Connector("q_m", ("output",), "rad"),
    Connector("X", ("output",), "m"),
    Connector("q_m_ref", ("calculatedParameter", "output"), "rad"),
    Connector("u_m0", ("calculatedParameter", "output"), "N.m"),
    Connector("q_a_start", ("parameter",), "rad"),
)

CONTROLLER: tuple[Connector, ...] = (
    Connector("q_m", ("input",), "rad"),
    Connector("u_m", ("output",), "N.m"),
    Connector("q_m_ref", ("input", "parameter"), "rad"),
    Connector("u_m0", ("input", "parameter"), "N.m", required=False),
)


@dataclass(frozen=True)
class Bound:
    """A connector found in an FMU: value references of its two components and their causality there."""

    references: tuple[int, int]
    causality: str


Binding = Mapping[str, Bound]
"""Bound connectors by name; absent where an optional one is missing."""


def bind(description: ModelDescription, connectors: tuple[Connector, ...], what: str) -> Binding:
    """Find the variables of all ``connectors`` in an FMU.

    Raises :class:`InputError` naming the connector and the nearest variables where a required one is missing or a
    variable has another causality or type; ``what`` ("The controller x.fmu") begins the message.
    """
    variables = {variable.name: variable for variable in description.modelVariables}
    binding: dict[str, Bound] = {}
    for connector in connectors:
        found = [variables.get(name) for name in connector.components()]
        if found == [None, None] and not connector.required:
            continue
        first, second = (
            _check(variable, name, connector, list(variables), what)
            for variable, name in zip(found, connector.components(), strict=True)
        )
        binding[connector.name] = Bound((int(first.valueReference), int(second.valueReference)), first.causality)
    return binding


def _check(
    variable: ScalarVariable | None, name: str, connector: Connector, names: list[str], what: str
) -> ScalarVariable:
    wanted = " or ".join(connector.causalities)
    if variable is None:
        near = ", ".join(difflib.get_close_matches(name, names, 3, 0.3)) or "none like it"
        raise InputError(
            f"{what} has no variable {name}: the benchmark needs a real {wanted} of that name "
            f"[{connector.unit}]. Nearest in the FMU: {near}."
        )
    if variable.type != "Real" or variable.causality not in connector.causalities:
        raise InputError(
            f"{what}: {name} is a {variable.type} {variable.causality}, but the benchmark needs a Real {wanted} "
            f"[{connector.unit}]. Change its declaration and export the FMU again."
        )
    return variable


def references(description: ModelDescription, causality: str, names: Iterable[str], what: str) -> dict[str, int]:
    """Value references of the real variables of one ``causality`` ("parameter", "output") by ``names``.

    Raises :class:`InputError` with the nearest names where one is unknown.
    """
    known = {
        variable.name: int(variable.valueReference)
        for variable in description.modelVariables
        if variable.causality == causality and variable.type == "Real"
    }
    for name in names:
        if name not in known:
            near = difflib.get_close_matches(name, known, 4, 0.3) or list(known)[:8]
            raise InputError(f"{what} has no {causality} {name}. Nearest: {', '.join(near)}.")
    return {name: known[name] for name in names}
