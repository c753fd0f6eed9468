"""The FMI 2.0 description of a controller in C from a table of its variables."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Protocol
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.export.description import BaseUnit, complete

_CAPABILITIES = ("canNotUseMemoryManagementFunctions", "canGetAndSetFMUstate", "canSerializeFMUstate")
_VARIABILITY = {"input": "continuous", "output": "discrete", "parameter": "fixed"}


class Row(Protocol):
    """A variable of the table, a scalar or a pair; ``least`` is the smallest value allowed, None if there is none."""

    @property
    def names(self) -> tuple[str, ...]: ...
    @property
    def causality(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def description(self) -> str: ...
    @property
    def least(self) -> float | None: ...


def head(what: str, step: float, *further: str) -> Element:
    """Return the FMI 2.0 description of a co-simulation FMU in C that is ``what``, up to its variables.

    ``step`` [s] is the step it is made for, ``further`` are capabilities beside those of all FMUs in C.
    """
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName="",
        guid="",
        description=what,
        variableNamingConvention="structured",
    )
    SubElement(root, "CoSimulation", dict.fromkeys((*further, *_CAPABILITIES), "true"), modelIdentifier="")
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="Reasons of calls that failed")
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="26", stepSize=repr(step))
    return root


def description(
    rows: Iterable[Row], starts: Mapping[str, float], what: str, base_units: Mapping[str, BaseUnit]
) -> Element:
    """Return the description of a controller that is ``what``; its variables start at ``starts``, or else at zero.

    Value references count the names of ``rows`` in their order. Raises :class:`UnitError` if a unit is neither known
    nor one of ``base_units``.
    """
    root = head(what, 0.00025)
    root.set("numberOfEventIndicators", "0")
    listed, outputs = SubElement(root, "ModelVariables"), []
    named = [(row, name) for row in rows for name in row.names]
    for reference, (row, name) in enumerate(named):
        kind = {"causality": row.causality, "variability": _VARIABILITY[row.causality]}
        attributes = {"name": name, "valueReference": str(reference), "description": row.description}
        real = SubElement(SubElement(listed, "ScalarVariable", attributes | kind), "Real", unit=row.unit)
        if row.causality == "output":
            outputs.append(str(reference + 1))
        else:
            real.set("start", repr(float(starts.get(name, 0.0))))
        if row.least is not None:
            real.set("min", repr(row.least))
    structure = SubElement(SubElement(root, "ModelStructure"), "Outputs")
    for index in outputs:
        SubElement(structure, "Unknown", index=index, dependencies="")
    return complete(root, base_units=base_units)
