"""One description for all kinds of FMI: translates one of FMI 2.0 co-simulation to the others."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.export.archive import BuildError
from controller_fmu.export.description import array_name, variables


@dataclass(frozen=True)
class Dialect:
    """The kind of FMU a model is built for; raises :class:`BuildError` for one that does not exist."""

    version: Literal[1, 2, 3] = 2
    """FMI 1.0, 2.0 or 3.0; FMI 1.0 is for co-simulation only."""
    interface: Literal["CoSimulation", "ModelExchange"] = "CoSimulation"
    """In Model Exchange the model is sampled by time events."""
    arrays: bool = False
    """FMI 3.0: ``q_m`` with two elements instead of ``q_m[1]`` and ``q_m[2]``."""
    float_bits: Literal[32, 64] = 64
    """FMI 3.0: variables are Float64 or Float32; the model computes in double precision either way."""

    def __post_init__(self) -> None:
        if self.version == 1 and self.interface == "ModelExchange":
            raise BuildError("FMI 1 is for co-simulation here; build for FMI 2 or 3 (--fmi 2), or no Model Exchange")
        if self.version != 3 and self.arrays:
            raise BuildError(f"FMI {self.version} has no arrays; build for FMI 3 (--fmi 3), or without arrays")
        if self.version != 3 and self.float_bits != 64:
            raise BuildError(f"FMI {self.version} has no Float{self.float_bits}; build for FMI 3 (--fmi 3)")

    @property
    def guid_attribute(self) -> str:
        """The attribute of the description's root that holds the GUID."""
        return "instantiationToken" if self.version == 3 else "guid"

    @property
    def float_type(self) -> str:
        """FMI 3.0's name for the type of the variables."""
        return f"Float{self.float_bits}"


def translate(root: Element, dialect: Dialect) -> Element:
    """Return in ``dialect`` what the FMI 2.0 co-simulation description ``root`` says; it stays as is."""
    if dialect.version == 1:
        return _fmi1(root)
    if dialect.version == 3:
        return _fmi3(root, dialect)
    return _fmi2(root, dialect)


def _copy_attributes(source: Element, names: tuple[str, ...]) -> dict[str, str]:
    return {name: source.attrib[name] for name in names if name in source.attrib}


def _child(root: Element, path: str) -> Element:
    child = root.find(path)
    if child is None:
        whose = f"the variable {root.get('name')}" if root.tag == "ScalarVariable" else "the model description"
        raise BuildError(f"{whose} has no {path}; add it")
    return child


# ---- FMI 2.0 ----


def _fmi2(root: Element, dialect: Dialect) -> Element:
    translated = Element(root.tag, root.attrib)
    for child in root:
        is_interface = child.tag == "CoSimulation" and dialect.interface == "ModelExchange"
        translated.append(_model_exchange2(child) if is_interface else child)
    return translated


def _model_exchange2(interface: Element) -> Element:
    kept = (
        "modelIdentifier",
        "canNotUseMemoryManagementFunctions",
        "canGetAndSetFMUstate",
        "canSerializeFMUstate",
    )
    attributes = {"completedIntegratorStepNotNeeded": "true", **_copy_attributes(interface, kept)}
    return Element("ModelExchange", attributes)


# ---- FMI 1.0 ----

_CAUSALITY_1 = {"input": "input", "output": "output"}
_VARIABILITY_1 = {"fixed": "parameter", "tunable": "parameter"}


def _fmi1(root: Element) -> Element:
    kept = ("modelName", "description", "author", "version", "generationTool", "variableNamingConvention")
    interface = _child(root, "CoSimulation")
    translated = Element(
        root.tag,
        {
            "fmiVersion": "1.0",
            **_copy_attributes(root, kept),
            "modelIdentifier": interface.attrib["modelIdentifier"],
            "numberOfContinuousStates": "0",
            "numberOfEventIndicators": "0",
        },
    )
    units = SubElement(translated, "UnitDefinitions")
    for unit in root.iterfind("UnitDefinitions/Unit"):
        SubElement(units, "BaseUnit", unit=unit.attrib["name"])
    for experiment in root.iterfind("DefaultExperiment"):
        SubElement(translated, experiment.tag, _copy_attributes(experiment, ("startTime", "stopTime", "tolerance")))
    listed = SubElement(translated, "ModelVariables")
    listed.extend(_variable1(variable) for variable in variables(root))
    capabilities = ("canHandleVariableCommunicationStepSize", "canNotUseMemoryManagementFunctions")
    kind = SubElement(SubElement(translated, "Implementation"), "CoSimulation_StandAlone")
    SubElement(kind, "Capabilities", _copy_attributes(interface, capabilities))
    return translated


def _variable1(variable: Element) -> Element:
    attributes = _copy_attributes(variable, ("name", "valueReference", "description"))
    causality, variability = variable.get("causality", "local"), variable.get("variability", "continuous")
    attributes["causality"] = _CAUSALITY_1.get(causality, "internal")
    attributes["variability"] = _VARIABILITY_1.get(variability, variability)
    translated = Element(variable.tag, attributes)
    translated.append(_child(variable, "Real"))
    return translated


# ---- FMI 3.0 ----

# What FMI 3 spells differently, and what it has dropped.
_RENAMED_3 = {"canGetAndSetFMUstate": "canGetAndSetFMUState", "canSerializeFMUstate": "canSerializeFMUState"}
_DROPPED_3 = ("canNotUseMemoryManagementFunctions",)
_COMMON_3 = ("UnitDefinitions", "LogCategories", "DefaultExperiment")


def _fmi3(root: Element, dialect: Dialect) -> Element:
    kept = ("modelName", "description", "author", "version", "license", "variableNamingConvention")
    translated = Element(root.tag, {"fmiVersion": "3.0", **_copy_attributes(root, kept), "instantiationToken": ""})
    translated.append(_interface3(_child(root, "CoSimulation"), dialect))
    translated.extend(child for tag in _COMMON_3 for child in root.iterfind(tag))
    groups = _arrays(variables(root)) if dialect.arrays else [[variable] for variable in variables(root)]
    listed = SubElement(translated, "ModelVariables")
    listed.extend(_variable3(group, dialect) for group in groups)
    time_reference = 1 + max(int(variable.attrib["valueReference"]) for variable in variables(root))
    time = {"valueReference": str(time_reference), "causality": "independent", "variability": "continuous"}
    SubElement(listed, dialect.float_type, {"name": "time", **time, "description": "Simulation time [s]"})
    structure = SubElement(translated, "ModelStructure")
    outputs = [group[0].attrib["valueReference"] for group in groups if group[0].get("causality") == "output"]
    for tag in ("Output", "InitialUnknown"):
        for reference in outputs:
            SubElement(structure, tag, valueReference=reference)
    return translated


def _interface3(interface: Element, dialect: Dialect) -> Element:
    attributes = {_RENAMED_3.get(name, name): value for name, value in interface.attrib.items()}
    for name in _DROPPED_3:
        attributes.pop(name, None)
    if dialect.interface == "ModelExchange":
        attributes.pop("canHandleVariableCommunicationStepSize", None)
    return Element(dialect.interface, attributes)


def _arrays(scalars: list[Element]) -> list[list[Element]]:
    """Group elements of one array; they follow each other in the list and in their value references."""
    groups: dict[str, list[Element]] = {}
    for scalar in scalars:
        groups.setdefault(array_name(scalar), []).append(scalar)
    return list(groups.values())


def _variable3(elements: list[Element], dialect: Dialect) -> Element:
    first = elements[0]
    attributes = _copy_attributes(first, ("name", "valueReference", "causality", "variability", "description"))
    attributes["name"] = array_name(first) if dialect.arrays else first.attrib["name"]
    reals = [_child(element, "Real") for element in elements]
    attributes["unit"] = reals[0].attrib["unit"]
    if "start" in reals[0].attrib:
        attributes["start"] = " ".join(real.attrib["start"] for real in reals)
    variable = Element(dialect.float_type, attributes)
    if len(elements) > 1:
        SubElement(variable, "Dimension", start=str(len(elements)))
    return variable
