"""Completes an FMI 2.0 model description with what exporters leave out and a strict validation wants."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from xml.etree import ElementTree
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.errors import DescriptionError, UnitError
from controller_fmu.export.units import BASE_UNITS, base_exponents

BaseUnit = Mapping[str, float]
"""Exponents of FMI's base units, factor and offset: ``{"rad": 1, "factor": 0.0174532925199433}`` for a degree."""

DEFAULTS = {"author": "FlexibleManipulator benchmark contributors", "version": "1.0.0", "license": "MIT"}
"""Attributes of the description's root that a model gets unless it brings its own."""

# The order the schema wants; units come right behind the interface types.
_INTERFACES = ("ModelExchange", "CoSimulation")


def parse(xml: bytes) -> Element:
    """Return the root of the model description ``xml``; raises :class:`DescriptionError` if it is not XML."""
    try:
        return ElementTree.fromstring(xml)
    except ElementTree.ParseError as problem:
        raise DescriptionError(f"the model description is not well-formed XML: {problem}") from None


def to_bytes(root: Element) -> bytes:
    """Return the XML text of a description, indented, in UTF-8, always the same for the same tree."""
    ElementTree.indent(root)
    text: bytes = ElementTree.tostring(root, encoding="UTF-8", xml_declaration=True)
    return text + b"\n"


def complete(
    root: Element,
    units: Mapping[str, str] | None = None,
    base_units: Mapping[str, BaseUnit] | None = None,
    enumerations: Mapping[str, Sequence[str]] | None = None,
) -> Element:
    """Add units, enumerations, initial unknowns and authorship to the FMI 2.0 description ``root`` in place; return it.

    A unit that is written in the description stays, as does a unit's definition. The creation date is removed, so that
    equal sources give equal bytes.

    Args:
        root: the description.
        units: unit of each real variable by its name without index, ``{"q_m": "rad"}``; "1" if it is dimensionless.
            None for a description that is written by hand and carries its units itself.
        base_units: definitions of units that :func:`base_exponents` does not know, by unit.
        enumerations: names of the items, which count from 1, of each integer variable that is an enumeration.

    Raises:
        UnitError: a real variable has no unit, or one that is neither known nor defined.
        DescriptionError: there is no ModelStructure, or an enumeration is no integer variable.
    """
    root.attrib.pop("generationDateAndTime", None)
    for name, value in DEFAULTS.items():
        root.attrib.setdefault(name, value)
    _set_units(root, units)
    _define_units(root, base_units or {}, _DEFINE_IN_XML if units is None else _DEFINE_IN_PYTHON)
    _define_enumerations(root, enumerations or {})
    _list_initial_unknowns(root)
    return root


def variables(root: Element) -> list[Element]:
    """Return the ScalarVariable elements; FMI 2.0 counts them from 1."""
    return root.findall("ModelVariables/ScalarVariable")


def derivatives(root: Element) -> list[tuple[int, int]]:
    """Return the indices of each continuous state and its derivative, in the order of ModelStructure/Derivatives.

    Raises :class:`DescriptionError` if something is listed there that is not declared as a derivative of a variable.
    """
    by_index = {str(index): variable for index, variable in enumerate(variables(root), start=1)}
    pairs = []
    for unknown in root.iterfind("ModelStructure/Derivatives/Unknown"):
        index = unknown.attrib["index"]
        real = by_index[index].find("Real") if index in by_index else None
        state = "" if real is None else real.get("derivative", "")
        if state not in by_index:
            what = f"Derivatives lists the index {index}, which is not that of the derivative of a variable"
            raise DescriptionError(what, value=index, remedy='declare it with <Real derivative="index of the state"/>')
        pairs.append((int(state), int(index)))
    return pairs


def array_name(variable: Element) -> str:
    """Return the name of a variable without its index: ``q_m`` of ``q_m[1]``."""
    return variable.attrib["name"].partition("[")[0]


_DEFINE_IN_XML = (
    'define it in the modelDescription.xml: <UnitDefinitions><Unit name="deg"><BaseUnit rad="1" '
    'factor="0.0174532925199433"/></Unit></UnitDefinitions>'
)
_DEFINE_IN_PYTHON = 'define it beside UNITS: BASE_UNITS = {"deg": {"rad": 1, "factor": 0.0174532925199433}}'


def _set_units(root: Element, units: Mapping[str, str] | None) -> None:
    idle = set(units or ()) - {array_name(variable) for variable in variables(root)}
    for variable in variables(root):
        real = variable.find("Real")
        if real is None or "unit" in real.attrib:
            continue
        name, whole = array_name(variable), variable.attrib["name"]
        if units is None:
            remedy = 'give it one: <Real unit="N.m/rad" .../>, unit="1" if it is dimensionless'
            raise UnitError(f"the variable {whole!r} has no unit", value=whole, remedy=remedy)
        if name not in units:
            near = tuple(difflib.get_close_matches(name, idle))
            remedy = f"add {name!r} to the dict UNITS, with '1' if it is dimensionless"
            raise UnitError(f"the variable {whole!r} has no unit", value=whole, nearest=near, remedy=remedy)
        real.set("unit", units[name])


def _define_units(root: Element, base_units: Mapping[str, BaseUnit], remedy: str) -> None:
    used = {real.attrib["unit"] for real in root.iterfind("ModelVariables/ScalarVariable/Real")}
    definition_of = {unit.attrib["name"]: unit for unit in root.iterfind("UnitDefinitions/Unit[BaseUnit]")}
    definition_of |= {unit: _unit(unit, attributes) for unit, attributes in base_units.items()}
    for old in root.findall("UnitDefinitions"):
        root.remove(old)
    definitions, allowed = Element("UnitDefinitions"), (*BASE_UNITS, "factor", "offset")
    for unit in sorted(used):
        try:
            definitions.append(definition_of[unit] if unit in definition_of else _unit(unit, base_exponents(unit)))
        except UnitError as error:
            error.remedy = remedy
            raise
        given = [name for base in definitions[-1].iterfind("BaseUnit") for name in base.attrib]
        for name in (name for name in given if name not in allowed):
            near = tuple(difflib.get_close_matches(name, allowed))
            raise UnitError(f"the unit {unit!r} has the unknown base unit {name!r}", value=name, nearest=near)
    root.insert(sum(child.tag in _INTERFACES for child in root), definitions)


def _define_enumerations(root: Element, enumerations: Mapping[str, Sequence[str]]) -> None:
    if not enumerations:
        return
    integers = {variable.attrib["name"]: variable.find("Integer") for variable in variables(root)}
    types = Element("TypeDefinitions")
    for name, items in enumerations.items():
        integer = integers.get(name)
        if integer is None:
            near = tuple(difflib.get_close_matches(name, [name for name, one in integers.items() if one is not None]))
            what = f"there is no integer variable {name!r} to be an enumeration"
            raise DescriptionError(what, value=name, nearest=near, remedy="register an Integer of this name")
        # Both types pass the same functions of FMI 2.0, so that the slave's code stays as it is.
        integer.tag = "Enumeration"
        integer.set("declaredType", name)
        listed = SubElement(SubElement(types, "SimpleType", name=name), "Enumeration")
        for value, item in enumerate(items, start=1):
            SubElement(listed, "Item", name=item, value=str(value))
    root.insert(sum(child.tag in (*_INTERFACES, "UnitDefinitions") for child in root), types)


def _unit(unit: str, attributes: BaseUnit) -> Element:
    element = Element("Unit", name=unit)
    SubElement(element, "BaseUnit", {name: str(value) for name, value in attributes.items()})
    return element


def _list_initial_unknowns(root: Element) -> None:
    structure = root.find("ModelStructure")
    if structure is None:
        what, remedy = "the model description has no ModelStructure", "add it, with the Outputs"
        raise DescriptionError(what, value="ModelStructure", remedy=remedy)
    for old in structure.findall("InitialUnknowns"):
        structure.remove(old)
    dynamic = {index for pair in derivatives(root) for index in pair}
    numbered = enumerate(variables(root), start=1)
    indices = [index for index, variable in numbered if _is_initial_unknown(variable, index in dynamic)]
    if indices:
        unknowns = SubElement(structure, "InitialUnknowns")
        for index in indices:
            SubElement(unknowns, "Unknown", index=str(index))


def _is_initial_unknown(variable: Element, dynamic: bool) -> bool:
    """Whether initialization computes a variable that is an output or ``dynamic``, a state or its derivative."""
    causality = variable.attrib.get("causality", "local")
    is_constant = variable.attrib.get("variability") == "constant"
    initial = variable.attrib.get("initial", "exact" if is_constant else "calculated")
    return causality == "calculatedParameter" or ((causality == "output" or dynamic) and initial != "exact")
