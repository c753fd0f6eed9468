"""FMUs of C models of tests: their variables, a description from these, and the stubs in ``tests/stubs``."""

import re
import tempfile
from collections.abc import Iterable, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import build_fmus
from controller_fmu.export.description import to_bytes
from support.tools import require

SOURCES = Path(__file__).parents[1] / "stubs"

STRICT = "-Wall -Wextra -Wno-unused-parameter -Wno-strict-prototypes -pedantic -Werror"
"""Options of a compiler to which a warning is an error, but for what the standards' own headers and functions have."""

Row = tuple[str, str, str, float | None]
"""Name, causality, unit, start value of a variable."""


def strict_compiler() -> str:
    """The environment's CC with which a build fails at a warning; the test is skipped where there is no compiler."""
    require("compiler")
    return f"{' '.join(build_fmus.find_compiler() or ())} {STRICT}"


def rows_of(stub: str) -> list[Row]:
    """The variables of a stub, from the comments in its struct: ``double K; /* parameter [N.m/rad] 45: gain */``."""
    line = r"^    double (\w+)(\[AXES\])?; +/\* (\w+) \[(.+?)\]( \d\w*)?.*\*/$"
    rows: list[Row] = []
    for name, array, causality, unit, start in re.findall(line, (SOURCES / f"{stub}.c").read_text(), re.MULTILINE):
        value = float(start or 0.0) if causality in ("input", "parameter") else None
        rows += [(each, causality, unit, value) for each in ([f"{name}[1]", f"{name}[2]"] if array else [name])]
    return rows


def axes(**pairs: Iterable[float]) -> dict[str, float]:
    """Parameters by name, a value for each axis."""
    return {f"{name}[{i}]": float(value) for name, pair in pairs.items() for i, value in enumerate(pair, start=1)}


FEEDTHROUGH, PROBE_PLANT = rows_of("feedthrough"), rows_of("probe_plant")
CONTROLLER = FEEDTHROUGH[:8]
"""The connectors."""


def description(rows: Sequence[Row], step_size: float | None = None, **abilities: str) -> bytes:
    """A description of FMI 2.0 co-simulation with ``rows`` in the order of value references."""
    root = Element("fmiModelDescription", fmiVersion="2.0", modelName="", guid="", description="stub")
    root.set("variableNamingConvention", "structured")
    SubElement(root, "CoSimulation", abilities, modelIdentifier="")
    if step_size is not None:
        SubElement(root, "DefaultExperiment", stepSize=repr(step_size))
    listed = SubElement(root, "ModelVariables")
    outputs = SubElement(SubElement(root, "ModelStructure"), "Outputs")
    for reference, (name, causality, unit, start) in enumerate(rows):
        variability = "continuous" if causality in ("input", "output") else "fixed"
        attributes = {"name": name, "causality": causality, "variability": variability}
        scalar = SubElement(listed, "ScalarVariable", attributes, valueReference=str(reference))
        SubElement(scalar, "Real", {"unit": unit} | ({} if start is None else {"start": repr(start)}))
        if causality == "output":
            SubElement(outputs, "Unknown", index=str(reference + 1))
    return to_bytes(root)


def build_model(
    sources: Sequence[Path], described: bytes, target: Path, dialect: build_fmus.Dialect | None = None
) -> Path:
    """Build the FMU ``target`` of C sources; the test is skipped where there is no C compiler."""
    require("compiler")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "modelDescription.xml")
        file.write_bytes(described)
        return build_fmus.c_fmu(sources, file, target, dialect or build_fmus.Dialect())


def build_stub(name: str, rows: Sequence[Row], folder: Path) -> Path:
    """Build the FMU of ``tests/stubs/NAME.c``, whose variables are ``rows``."""
    described = description(rows, canHandleVariableCommunicationStepSize="true")
    return build_model([SOURCES / f"{name}.c"], described, folder / f"{name}.fmu")
