"""FMUs of the C stubs in ``tests/stubs``: their variables, and a build of a description from these."""

from __future__ import annotations

from pathlib import Path
from xml.etree.ElementTree import Element, ElementTree, SubElement

import build_fmus

SOURCES = Path(__file__).parent / "stubs"

Row = tuple[str, str, str, float | None]
"""Name, causality, unit, start value of a variable."""


def pair(name: str, causality: str, unit: str, start: float | None = None) -> list[Row]:
    """Both components of a connector or a parameter per axis."""
    return [(f"{name}[{i}]", causality, unit, start) for i in (1, 2)]


FEEDTHROUGH: list[Row] = [
    *pair("q_m_ref", "input", "rad", 0.0),
    *pair("q_m", "input", "rad", 0.0),
    *pair("u_m", "output", "N.m"),
    *pair("u_m0", "parameter", "N.m", 0.0),
    ("K", "parameter", "N.m/rad", 0.0),
    ("nan_from", "parameter", "s", 1e9),
    ("fail_from", "parameter", "s", 1e9),
]

PROBE_PLANT: list[Row] = [
    *pair("u_m", "input", "N.m", 0.0),
    *pair("u_d", "input", "N.m", 0.0),
    *pair("F", "input", "N", 0.0),
    *pair("q_m", "output", "rad"),
    *pair("q_a", "output", "rad"),
    *pair("X", "output", "m"),
    *pair("arrival", "output", "s"),
    *pair("acting", "output", "N.m"),
    *pair("disturbing", "output", "N.m"),
    *pair("pushing", "output", "N"),
    ("steps", "output", "1", None),
    *pair("q_m_ref", "calculatedParameter", "rad"),
    *pair("u_m0", "calculatedParameter", "N.m"),
    *pair("q_a_start", "parameter", "rad", 0.0),
    *pair("rest", "parameter", "rad", 0.0),
    *pair("hold", "parameter", "N.m", 0.0),
    *pair("rate", "parameter", "rad/s", 0.0),
    *pair("jump_at", "parameter", "s", 1e9),
    *pair("jump", "parameter", "rad", 0.0),
    ("far_from", "parameter", "s", 1e9),
    ("fail_from", "parameter", "s", 1e9),
]

VARIABILITY = {"input": "continuous", "output": "continuous", "parameter": "fixed", "calculatedParameter": "fixed"}


def build_stub(name: str, rows: list[Row], folder: Path) -> Path:
    """Build the FMU of ``tests/stubs/NAME.c``, whose variables are ``rows`` in the order of value references.

    Raises ``build_fmus.NoCompilerError`` where there is no C compiler.
    """
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName=name, guid="", description="stub")
    SubElement(root, "CoSimulation", modelIdentifier=name, canHandleVariableCommunicationStepSize="true")
    listed = SubElement(root, "ModelVariables")
    structure = SubElement(root, "ModelStructure")
    outputs = SubElement(structure, "Outputs")
    for reference, (variable, causality, unit, start) in enumerate(rows):
        scalar = SubElement(
            listed,
            "ScalarVariable",
            name=variable,
            valueReference=str(reference),
            causality=causality,
            variability=VARIABILITY[causality],
        )
        SubElement(scalar, "Real", {"unit": unit} | ({} if start is None else {"start": repr(start)}))
        if causality == "output":
            SubElement(outputs, "Unknown", index=str(reference + 1))
    description = folder / f"{name}.xml"
    ElementTree(root).write(description, encoding="UTF-8", xml_declaration=True)
    return build_fmus.c_fmu([SOURCES / f"{name}.c"], description, folder / f"{name}.fmu")
