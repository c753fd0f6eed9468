"""One description for all kinds of FMI: translates one of FMI 2.0 co-simulation to the others."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Literal
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.errors import DescriptionError, DialectError
from controller_fmu.export.description import array_name, variables

_LATER, _ONLY_3 = "build for FMI 2 or 3", "build for FMI 3"


@dataclass(frozen=True)
class Dialect:
    """The kind of FMU a model is built for; raises :class:`DialectError` for one that does not exist."""

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
            raise DialectError("FMI 1 is for co-simulation here", value=self.interface, remedy=_LATER)
        if self.version != 3 and self.arrays:
            raise DialectError(f"FMI {self.version} has no arrays", value="arrays", remedy=_ONLY_3)
        if self.version != 3 and self.float_bits != 64:
            value = f"Float{self.float_bits}"
            raise DialectError(f"FMI {self.version} has no {value}", value=value, remedy=_ONLY_3)

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
        whose = f"the variable {root.get('name')!r}" if root.tag == "ScalarVariable" else "the model description"
        raise DescriptionError(f"{whose} has no {path}", value=path, remedy="add it")
    return child


# ---- FMI 2.0 ----

_STATES_2 = ("canGetAndSetFMUstate", "canSerializeFMUstate")
_KEPT_2 = ("modelIdentifier", "canNotUseMemoryManagementFunctions", *_STATES_2)


def _fmi2(root: Element, dialect: Dialect) -> Element:
    translated = Element(root.tag, root.attrib)
    for child in root:
        if child.tag == "CoSimulation" and dialect.interface == "ModelExchange":
            attributes = {"completedIntegratorStepNotNeeded": "true", **_copy_attributes(child, _KEPT_2)}
            child = Element("ModelExchange", attributes)
        translated.append(child)
    return translated


# ---- FMI 1.0 ----


def _fmi1(root: Element) -> Element:
    kept = ("modelName", "description", "author", "version", "generationTool", "variableNamingConvention")
    interface = _child(root, "CoSimulation")
    none = dict.fromkeys(("numberOfContinuousStates", "numberOfEventIndicators"), "0")
    attributes = {**_copy_attributes(root, kept), "modelIdentifier": interface.attrib["modelIdentifier"], **none}
    translated = Element(root.tag, {"fmiVersion": "1.0", **attributes})
    units = SubElement(translated, "UnitDefinitions")
    for unit in root.iterfind("UnitDefinitions/Unit"):
        SubElement(units, "BaseUnit", unit=unit.attrib["name"])
    for experiment in root.iterfind("DefaultExperiment"):
        SubElement(translated, experiment.tag, _copy_attributes(experiment, ("startTime", "stopTime", "tolerance")))
    listed = SubElement(translated, "ModelVariables")
    listed.extend([_variable1(variable) for variable in variables(root)])  # extend hides errors of a generator
    capabilities = ("canHandleVariableCommunicationStepSize", "canNotUseMemoryManagementFunctions")
    kind = SubElement(SubElement(translated, "Implementation"), "CoSimulation_StandAlone")
    SubElement(kind, "Capabilities", _copy_attributes(interface, capabilities))
    return translated


def _variable1(variable: Element) -> Element:
    attributes = _copy_attributes(variable, ("name", "valueReference", "description"))
    causality, variability = variable.get("causality", "local"), variable.get("variability", "continuous")
    attributes["causality"] = causality if causality in ("input", "output") else "internal"
    attributes["variability"] = "parameter" if variability in ("fixed", "tunable") else variability
    translated = Element(variable.tag, attributes)
    translated.append(_child(variable, "Real"))
    return translated


# ---- FMI 3.0 ----

# What FMI 3 spells differently, and what it has dropped.
_RENAMED_3 = {name: name.replace("FMUstate", "FMUState") for name in _STATES_2}
_DROPPED_3 = ("canNotUseMemoryManagementFunctions",)
_COMMON_3 = ("UnitDefinitions", "LogCategories", "DefaultExperiment")


def _fmi3(root: Element, dialect: Dialect) -> Element:
    kept = ("modelName", "description", "author", "version", "license", "generationTool", "variableNamingConvention")
    translated = Element(root.tag, {"fmiVersion": "3.0", **_copy_attributes(root, kept), "instantiationToken": ""})
    translated.append(_interface3(_child(root, "CoSimulation"), dialect))
    translated.extend(child for tag in _COMMON_3 for child in root.iterfind(tag))
    groups: dict[str, list[Element]] = {}
    owners = []
    for scalar in variables(root):
        group = groups.setdefault(array_name(scalar) if dialect.arrays else scalar.attrib["valueReference"], [])
        group.append(scalar)
        owners.append(group[0].attrib["valueReference"])

    def reference(index: str) -> str:
        if not (index.isdigit() and 1 <= int(index) <= len(owners)):
            raise DescriptionError(f"no variable has the index {index}: there are {len(owners)}", value=index)
        return owners[int(index) - 1]

    listed = SubElement(translated, "ModelVariables")
    translations = [_variable3(group, dialect, reference) for group in groups.values()]
    listed.extend(translations)  # which hides errors of a generator
    time_reference = 1 + max(int(variable.attrib["valueReference"]) for variable in variables(root))
    time = {"valueReference": str(time_reference), "causality": "independent", "variability": "continuous"}
    SubElement(listed, dialect.float_type, {"name": "time", **time, "description": "Simulation time [s]"})
    translated.append(_structure3(root, reference, dialect))
    return translated


_STRUCTURE_3 = {"Outputs": "Output", "Derivatives": "ContinuousStateDerivative", "InitialUnknowns": "InitialUnknown"}


Reference = Callable[[str], str]
"""From the index of a scalar to the value reference of the variable that it is, or is an element of."""


def _structure3(root: Element, reference: Reference, dialect: Dialect) -> Element:
    structure = Element("ModelStructure")
    for old, new in _STRUCTURE_3.items():
        listed: dict[str, Element] = {}
        for unknown in root.iterfind(f"ModelStructure/{old}/Unknown"):
            value_reference = reference(unknown.attrib["index"])
            listed.setdefault(value_reference, Element(new, valueReference=value_reference))
            if "dependencies" in unknown.attrib and not dialect.arrays:
                dependencies = map(reference, unknown.attrib["dependencies"].split())
                listed[value_reference].set("dependencies", " ".join(dependencies))
        structure.extend(listed.values())
    return structure


def _interface3(interface: Element, dialect: Dialect) -> Element:
    attributes = {_RENAMED_3.get(name, name): value for name, value in interface.attrib.items()}
    for name in _DROPPED_3:
        attributes.pop(name, None)
    if dialect.interface == "ModelExchange":
        attributes.pop("canHandleVariableCommunicationStepSize", None)
    return Element(dialect.interface, attributes)


def _variable3(elements: list[Element], dialect: Dialect, reference: Reference) -> Element:
    first = elements[0]
    attributes = _copy_attributes(first, ("name", "valueReference", "causality", "variability", "description"))
    attributes["name"] = array_name(first) if dialect.arrays else first.attrib["name"]
    reals = [_child(element, "Real") for element in elements]
    attributes["unit"] = reals[0].attrib["unit"]
    starts = [real.attrib["start"] for real in reals if "start" in real.attrib]
    if starts:
        attributes["start"] = " ".join(starts)
    if "derivative" in reals[0].attrib:
        attributes["derivative"] = reference(reals[0].attrib["derivative"])
    if len(starts) not in (0, len(reals)):
        what = f"some elements of the array {attributes['name']!r} have a start value, others have none"
        raise DescriptionError(what, value=attributes["name"])
    variable = Element(dialect.float_type, attributes)
    if len(elements) > 1:
        SubElement(variable, "Dimension", start=str(len(elements)))
    return variable
