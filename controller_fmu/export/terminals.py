"""Terminals and icons after FMI 3.0, Section 2.4.9; FMI 2.0.4 has taken them over as they are."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

from controller_fmu.export.description import to_bytes

ICON = Path(__file__).with_name("icon.png")
FOLDER = "terminalsAndIcons"

TERMINALS: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "motors": ("motor angles and torques", {"q_m": "q_m", "u_m": "u_m"}),
    "controller": ("motor angles and torques, for the controller", {"q_m": "y", "u_m": "u_c"}),
    "disturbances": ("torques on the motors, force on the tool", {"u_d": "u_d", "F": "F"}),
}
"""Description and members, each with the variable that it is; an FMU has those terminals whose variables it has."""


def terminals_and_icons(root: Element, version: int) -> dict[str, bytes]:
    """Return the files, by path in the archive, that the translated description ``root`` of an FMU asks for.

    One line between terminals with equal members connects two FMUs: ``motors`` of a controller fits ``motors`` of the
    plant.
    """
    if version == 1:
        return {}
    names = {element.get("name", "") for element in root.iterfind("ModelVariables/*")}
    described = Element("fmiTerminalsAndIcons", fmiVersion="3.0")
    drawn = SubElement(described, "GraphicalRepresentation")
    SubElement(drawn, "CoordinateSystem", x1="-100", y1="-100", x2="100", y2="100", suggestedScalingFactorTo_mm="0.1")
    SubElement(drawn, "Icon", x1="-100", y1="-100", x2="100", y2="100")
    listed = Element("Terminals")
    for name, (meaning, members) in TERMINALS.items():
        variable_of = {
            member + index: variable + index
            for member, variable in members.items()
            for index in ("", "[1]", "[2]")
            if variable + index in names
        }
        if {member.partition("[")[0] for member in variable_of} == set(members):
            terminal = SubElement(listed, "Terminal", name=name, matchingRule="plug", description=meaning)
            for member, variable in variable_of.items():
                how = {"variableName": variable, "memberName": member, "variableKind": "signal"}
                SubElement(terminal, "TerminalMemberVariable", how)
    if len(listed):
        described.append(listed)
    icon = ICON.read_bytes()
    files = {f"{FOLDER}/{FOLDER}.xml": to_bytes(described), f"{FOLDER}/icon.png": icon}
    return files | ({"model.png": icon} if version == 2 else {})
