"""The same binary under another model description: names, units and types as other tools or users write them."""

import re
from collections.abc import Callable
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.export.archive import pack, unpack, write_atomically
from controller_fmu.export.description import parse, to_bytes

Edit = Callable[[Element], None]
"""Changes the root of an FMI 2.0 or 3.0 model description in place."""

DESCRIPTION = "modelDescription.xml"


def edited(fmu: Path, target: Path, *edits: Edit) -> Path:
    """Write ``fmu`` with its description changed to ``target`` and return that; the GUID stays the binary's."""
    contents = unpack(fmu)
    root = parse(contents[DESCRIPTION])
    for edit in edits:
        edit(root)
    return write_atomically(pack({**contents, DESCRIPTION: to_bytes(root)}), target)


def each(change: Edit) -> Edit:
    """Apply ``change`` to every variable but the time."""

    def edit(root: Element) -> None:
        for variable in root.iterfind("ModelVariables/*"):
            if variable.get("causality") != "independent":
                change(variable)

    return edit


def rename(pattern: str, replacement: str) -> Edit:
    """Replace ``pattern`` (a regular expression) in the name of every variable."""
    return each(lambda variable: variable.set("name", re.sub(pattern, replacement, variable.attrib["name"])))


def without_units(root: Element) -> None:
    """Drop all units and their definitions, as most exporters do."""
    for definitions in root.findall("UnitDefinitions"):
        root.remove(definitions)
    each(lambda variable: _typed(variable).attrib.pop("unit", None))(root)


def unit(old: str, new: str, **base_unit: str) -> Edit:
    """Rename unit ``old`` to ``new`` and define that, ``factor`` and base units as in FMI's BaseUnit."""

    def change(variable: Element) -> None:
        if _typed(variable).get("unit") == old:
            _typed(variable).set("unit", new)

    def edit(root: Element) -> None:
        for definition in root.iterfind(f"UnitDefinitions/Unit[@name='{old}']"):
            definition.clear()
            definition.set("name", new)
            SubElement(definition, "BaseUnit", base_unit)
        each(change)(root)

    return edit


def declare(pattern: str, tag: str = "", **attributes: str) -> Edit:
    """Set attributes of the variables whose whole name matches ``pattern``, in FMI 2.0 also the type: ``Integer``."""

    def change(variable: Element) -> None:
        if re.fullmatch(pattern, variable.attrib["name"]):
            variable.attrib.update(attributes)
            if tag:
                variable[0].tag = tag
                variable[0].attrib.pop("unit", None)

    return each(change)


def _typed(variable: Element) -> Element:
    """The element that holds type, unit and start: a child in FMI 2.0, the variable itself in FMI 3.0."""
    return variable[0] if variable.tag == "ScalarVariable" else variable
