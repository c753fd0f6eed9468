"""Files that say how a controller is used: connector mappings (TOML, SSP's SSM) and parameters (TOML, JSON, SSP's SSV,
lines of names and values)."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmpy.model_description import BaseUnit, Unit
from lxml import etree

from ..bounded import read, read_toml
from ..codec import Scalar
from ..errors import InputError, unknown
from .archive import Archive
from .lookup import elements, number, place
from .variables import EXPONENTS, REAL_TYPES, SET_TYPES, factor_to_fmu_unit

TABLES = ("map", "parameters")
"""Of a TOML file."""

ENTRY = ("source", "target", "id", "description")
"""Attributes of a MappingEntry that change nothing, or are read."""

NAMESPACES = {
    "ParameterSet": re.compile(r"http://ssp-standard\.org/SSP[0-9]+/SystemStructureParameterValues"),
    "ParameterMapping": re.compile(r"http://ssp-standard\.org/SSP[0-9]+/SystemStructureParameterMapping"),
}

LINES = (".txt", ".par", ".properties")
"""Endings of files of lines ``name=value``, such as OpenModelica's for ``-overrideFile``."""

COMMENTS = ("#", "//")
"""Beginnings of a line that is a comment."""

BESIDE = ("Parameters", "Units", "Enumerations", "Annotations", "MetaData", "Signature", "Signatures")
"""Elements that a parameter set or a mapping may have beside what is read here."""

SSV_TYPES = {*SET_TYPES}
"""Elements with a value in SSP 1.0 and 2.0."""


def read_mapping(file: Path) -> dict[str, str]:
    """Connector to FMU variable. TOML: a table ``[map]`` of ``"q_m[1]" = "In1"``. SSM: ``MappingEntry`` elements."""
    if file.suffix == ".ssm":
        entries = _children(file, _root(file, "ParameterMapping", "bad-mapping"), "MappingEntry")
        if not entries:
            message = f"{file} has no MappingEntry. An SSP parameter mapping (.ssm) says which variable is which."
            raise InputError(message, "bad-mapping", file)
        targets = [entry.get("target", "") for entry in entries]
        if twice := [target for target in targets if targets.count(target) > 1]:
            raise InputError(f"{file} maps {twice[0]} more than once.", "bad-mapping", file, twice[0])
        for entry in entries:
            target = entry.get("target")
            for name, value in entry.attrib.items():
                if name not in ENTRY and (name, value) != ("suppressUnitConversion", "false"):
                    message = (
                        f"{file}: the mapping of {target} has the attribute {name}={value!r}, which is not supported."
                    )
                    raise InputError(message, "bad-mapping", file, name)
            for child in entry.iterchildren(etree.Element):
                kind = etree.QName(child).localname
                # A transformation that was passed over would leave a gain out of the loop, without a word.
                message = f"{file}: the mapping of {target} has a {kind}, which is not supported. "
                message += "Units are converted by the FMU's own unit definitions."
                raise InputError(message, "bad-mapping", file, target)
        return {entry.get("target", ""): entry.get("source", "") for entry in entries}
    table = _tables(file, "bad-mapping").get("map")
    if not isinstance(table, Mapping) or not all(isinstance(value, str) for value in table.values()):
        raise InputError(f'{file} has no table [map] of lines like "q_m[1]" = "In1".', "bad-mapping", file)
    return dict(table)


def read_mapped_parameters(file: Path, controller: Archive) -> dict[str, Scalar]:
    """The values that a mapping in TOML gives beside its table ``[map]``; an SSM has none. See
    :func:`read_parameters`."""
    table = None if file.suffix == ".ssm" else _tables(file, "bad-parameters").get("parameters")
    return {} if table is None else _table(file, table, controller)


def read_parameters(file: Path, controller: Archive) -> dict[str, Scalar]:
    """Values by name of a parameter or an input that nothing drives, in the unit the controller has for it.

    TOML: a table ``[parameters]`` of numbers, Booleans, texts or lists (``K_p = [45, 15]`` sets ``K_p[1]`` and
    ``K_p[2]``). JSON: one object of the same. Text (:data:`LINES`): lines ``name=value``. SSV: ``Parameter`` elements,
    whose units, if they have any, are converted.
    """
    if file.suffix == ".ssv":
        return _ssv_values(file, controller)
    if file.suffix == ".json":
        return _table(file, _json_values(file), controller)
    if file.suffix in LINES:
        return _table(file, _line_values(file), controller)
    return _table(file, _tables(file, "bad-parameters").get("parameters"), controller)


def _tables(file: Path, what: str) -> dict[str, Any]:
    """The tables of a TOML file, which may give parameters and a mapping; a word that is mistyped gave neither."""
    tables = read_toml(file)
    for name in tables:
        if name not in TABLES:
            raise unknown(
                f"{file} has {name}, and the tables [map] and [parameters] are read.", what, str(file), name, TABLES
            )
    return tables


def _table(file: Path, table: Any, controller: Archive) -> dict[str, Scalar]:
    if not isinstance(table, Mapping):
        raise InputError(f'{file} has no table [parameters] of lines like "K_p[1]" = 45.', "bad-parameters", file)
    for name, value in table.items():
        for element in value if isinstance(value, list) else [value]:
            if not isinstance(element, bool | int | float | str):
                message = f"{file}: the value of {name}, {element!r}, is neither a number nor true, false or a text."
                raise InputError(message, "bad-parameters", file, name)
    return elements(table, controller.description, str(file))


def _json_values(file: Path) -> dict[str, Any]:
    try:
        values = json.loads(read(file), object_pairs_hook=lambda pairs: _distinct(file, pairs))
    except (ValueError, RecursionError) as problem:  # RecursionError: brackets nested a thousand deep
        raise InputError(f"{file} is not a JSON file: {problem}.", "bad-file", file) from None
    if not isinstance(values, dict) or not values:
        message = f'{file} is no object of names and values, such as {{"K_p[1]": 45, "enable": true}}.'
        raise InputError(message, "bad-parameters", file)
    return values


def _line_values(file: Path) -> dict[str, Any]:
    try:
        lines = [line.strip() for line in read(file).decode("utf-8-sig").splitlines()]
    except UnicodeDecodeError as problem:
        raise InputError(f"{file} is not a text in UTF-8: {problem}.", "bad-file", file) from None
    pairs = []
    for number_of_line, line in enumerate(lines, start=1):
        if not line or line.startswith(COMMENTS):
            continue
        name, equals, value = (part.strip() for part in line.partition("="))
        if not (name and equals and value):
            message = f"{file}, line {number_of_line}: {line[:80]!r} is not of the form name=value."
            raise InputError(message, "bad-parameters", file, line[:80])
        pairs.append((name, value))
    if not pairs:
        raise InputError(f"{file} has no line of the form name=value.", "bad-parameters", file)
    return _distinct(file, pairs)


def _distinct(file: Path, pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = [name for name, _ in pairs]
    if len(set(names)) < len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{file} gives {twice} more than once.", "bad-parameters", file, twice)
    return dict(pairs)


def _ssv_values(file: Path, controller: Archive) -> dict[str, Scalar]:
    values: dict[str, Scalar] = {}
    root = _root(file, "ParameterSet", "bad-parameters")
    definitions: list[Unit] = []
    for element in root.iterfind("{*}Units/{*}Unit"):
        definitions.append(_unit(file, element))
        name = definitions[-1].name
        if [unit.name for unit in definitions].count(name) > 1:
            raise InputError(f"{file} defines the unit {name} more than once.", "bad-unit", file, name)
    groups = _children(file, root, "Parameters")
    for parameter in [child for group in groups for child in _children(file, group, "Parameter")]:
        name = parameter.get("name", "")
        types = [child for child in parameter.iterchildren(etree.Element) if etree.QName(child).localname in SSV_TYPES]
        if len(types) > 1:
            raise InputError(f"{file}: the parameter {name} has more than one value.", "bad-parameters", file, name)
        value = types[0].get("value") if types else None
        if value is None:
            message = f"{file}: the parameter {name} has no value of a type that parameters have, such as Real."
            raise InputError(message, "bad-parameters", file, name)
        if name in values:
            raise InputError(f"{file} gives {name} more than once.", "bad-parameters", file, name)
        values[name] = _number(file, name, value) if etree.QName(types[0]).localname in REAL_TYPES else value
        if unit := types[0].get("unit"):
            variable, _ = place(controller.description, name, f"The controller {controller.name}")
            where = f"{file}: the parameter {name}"
            factor = factor_to_fmu_unit(controller.description, variable.unit, unit, definitions, where)
            values[name] = _number(file, name, value) * factor
    if not values:
        message = f"{file} has no Parameter. An SSP parameter set (.ssv) says which parameter has which value."
        raise InputError(message, "bad-parameters", file)
    return values


def _unit(file: Path, element: etree._Element) -> Unit:
    name, base = element.get("name", ""), element.find("{*}BaseUnit")
    if base is None:
        return Unit(name)
    numbers = {key: _number(file, f"the unit {name}", base.get(key, "0")) for key in (*EXPONENTS, "offset")}
    return Unit(name, BaseUnit(**numbers, factor=_number(file, f"the unit {name}", base.get("factor", "1"))))


def _number(file: Path, name: str, value: Any) -> float:
    try:
        # float(True) is 1.0: a slip in a file would become a gain.
        if isinstance(value, bool):
            raise TypeError
        return number(value)
    except (TypeError, ValueError, OverflowError):
        message = f"{file}: the value of {name}, {value!r}, is not a number."
        raise InputError(message, "not-a-number", file, value) from None


def _root(file: Path, kind: str, what: str) -> etree._Element:
    """The root of an XML file; raises :class:`InputError` with the code ``what`` if it is no ``kind`` of SSP."""
    try:
        # No entities: a file of a stranger could read others by them ("XXE"), or grow to gigabytes.
        root = etree.fromstring(read(file), etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as problem:
        raise InputError(f"{file} is not a well-formed XML file: {problem}.", "bad-file", file) from None
    name = etree.QName(root)
    if name.localname != kind or not NAMESPACES[kind].fullmatch(name.namespace or ""):
        message = (
            f"{file} is a {name.localname} of the namespace {name.namespace or 'none'}, and a {kind} of SSP is read."
        )
        if name.localname == "SystemStructureDescription":
            message += f" Give its {kind} as a file of its own."
        raise InputError(message, what, file, name.localname)
    return root


def _children(file: Path, parent: etree._Element, kind: str) -> list[etree._Element]:
    """The children of a ``kind``. What lies elsewhere, such as in an annotation of another tool, does not count."""
    children = []
    for child in parent.iterchildren(etree.Element):
        name = etree.QName(child)
        if name.namespace == etree.QName(parent).namespace:
            if name.localname == kind:
                children.append(child)
            elif name.localname not in BESIDE:
                message = f"{file} has a {name.localname} in a {etree.QName(parent).localname}, which is not supported."
                raise InputError(message, "bad-file", file, name.localname)
    return children
