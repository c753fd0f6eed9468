"""Completes an FMI 2.0 model description with what exporters leave out and a strict validation wants."""

from __future__ import annotations

from collections.abc import Mapping
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.export.archive import BuildError
from controller_fmu.export.units import base_exponents

DEFAULTS = {"author": "FlexibleManipulator benchmark contributors", "version": "1.0.0", "license": "MIT"}
"""Attributes of the description's root that a model gets unless it brings its own."""

# The order the schema wants; units come right behind the interface types.
_INTERFACES = ("ModelExchange", "CoSimulation")


def parse(xml: bytes) -> Element:
    """Return the root of the model description ``xml``; raises :class:`BuildError` where that is not XML."""
    try:
        return ElementTree.fromstring(xml)
    except ElementTree.ParseError as problem:
        raise BuildError(f"the model description is no well-formed XML: {problem}; mend it there") from None


def to_bytes(root: Element) -> bytes:
    """Return the XML text of a description, indented, in UTF-8, always the same for the same tree."""
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def complete(root: Element, units: Mapping[str, str]) -> Element:
    """Add units, initial unknowns and authorship to the FMI 2.0 description ``root`` in place; return it.

    The creation date goes, because equal sources shall give equal bytes.

    Args:
        root: the description.
        units: unit of each real variable by its name without index, ``{"q_m": "rad"}``; "1" if it has none.
            A unit written in the description stays.

    Raises:
        BuildError: a real variable has no unit, or one whose spelling is unknown.
    """
    root.attrib.pop("generationDateAndTime", None)
    for name, value in DEFAULTS.items():
        root.attrib.setdefault(name, value)
    _set_units(root, units)
    _define_units(root)
    _list_initial_unknowns(root)
    return root


def variables(root: Element) -> list[Element]:
    """Return the ScalarVariable elements; FMI 2.0 counts them from 1."""
    return root.findall("ModelVariables/ScalarVariable")


def array_name(variable: Element) -> str:
    """Return the name of a variable without its index: ``q_m`` of ``q_m[1]``."""
    return variable.attrib["name"].partition("[")[0]


def _set_units(root: Element, units: Mapping[str, str]) -> None:
    for variable in variables(root):
        real = variable.find("Real")
        if real is None or "unit" in real.attrib:
            continue
        name = array_name(variable)
        if name not in units:
            raise BuildError(
                f"{root.get('modelName', 'the model')}: variable {variable.attrib['name']!r} has no unit; "
                f"add {name!r} to the model's UNITS ('1' if it is dimensionless)"
            )
        real.set("unit", units[name])


def _define_units(root: Element) -> None:
    used = {real.attrib["unit"] for real in root.iterfind("ModelVariables/ScalarVariable/Real")}
    old = root.find("UnitDefinitions")
    if old is not None:
        root.remove(old)
    definitions = Element("UnitDefinitions")
    for unit in sorted(used):
        exponents = {base: str(exponent) for base, exponent in base_exponents(unit).items()}
        SubElement(SubElement(definitions, "Unit", name=unit), "BaseUnit", exponents)
    root.insert(sum(child.tag in _INTERFACES for child in root), definitions)


def _list_initial_unknowns(root: Element) -> None:
    structure = root.find("ModelStructure")
    if structure is None:
        raise BuildError("the model description has no ModelStructure; add it, with the Outputs")
    for old in structure.findall("InitialUnknowns"):
        structure.remove(old)
    indices = [index for index, variable in enumerate(variables(root), start=1) if _is_initial_unknown(variable)]
    if indices:
        unknowns = SubElement(structure, "InitialUnknowns")
        for index in indices:
            SubElement(unknowns, "Unknown", index=str(index))


def _is_initial_unknown(variable: Element) -> bool:
    causality = variable.attrib.get("causality", "local")
    is_constant = variable.attrib.get("variability") == "constant"
    initial = variable.attrib.get("initial", "exact" if is_constant else "calculated")
    return causality == "calculatedParameter" or (causality == "output" and initial != "exact")
