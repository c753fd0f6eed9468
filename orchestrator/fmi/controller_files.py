"""Files that say how a controller is used: connector mappings (TOML, SSP's SSM) and parameters (TOML, SSP's SSV)."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from fmpy.model_description import BaseUnit, Unit
from lxml import etree

from ..bounded import read, read_toml
from ..codec import Scalar
from ..errors import InputError
from .archive import Archive
from .lookup import elements, place
from .units import EXPONENTS, factor_to_fmu_unit
from .variables import REAL_TYPES, SET_TYPES

SSV_TYPES = {*SET_TYPES}
"""Elements with a value in SSP 1.0 and 2.0."""


def read_mapping(file: Path) -> dict[str, str]:
    """Connector to FMU variable. TOML: a table ``[map]`` of ``"q_m[1]" = "In1"``. SSM: ``MappingEntry`` elements."""
    if file.suffix == ".ssm":
        entries = list(_root(file).iterfind(".//{*}MappingEntry"))
        if not entries:
            message = f"{file} has no MappingEntry. An SSP parameter mapping (.ssm) says which variable is which."
            raise InputError(message, "bad-mapping", file)
        targets = [entry.get("target", "") for entry in entries]
        if twice := [target for target in targets if targets.count(target) > 1]:
            raise InputError(f"{file} maps {twice[0]} more than once.", "bad-mapping", file, twice[0])
        for entry in entries:
            for child in entry.iterchildren(etree.Element):
                target, kind = entry.get("target"), etree.QName(child).localname
                # A transformation that was passed over would leave a gain out of the loop, without a word.
                message = f"{file}: the mapping of {target} has a {kind}, which is not supported. "
                message += "Units are converted by the FMU's own unit definitions."
                raise InputError(message, "bad-mapping", file, target)
        return {entry.get("target", ""): entry.get("source", "") for entry in entries}
    table = read_toml(file).get("map")
    if not isinstance(table, Mapping) or not all(isinstance(value, str) for value in table.values()):
        raise InputError(f'{file} has no table [map] of lines like "q_m[1]" = "In1".', "bad-mapping", file)
    return dict(table)


def read_mapped_parameters(file: Path) -> dict[str, Scalar]:
    """The values that a mapping in TOML gives beside its table ``[map]``; an SSM has none. See
    :func:`read_parameters`."""
    table = None if file.suffix == ".ssm" else read_toml(file).get("parameters")
    return {} if table is None else _table(file, table)


def read_parameters(file: Path, controller: Archive) -> dict[str, Scalar]:
    """Values by name of a parameter or an input that nothing drives, in the unit the controller has for it.

    TOML: a table ``[parameters]`` of numbers, Booleans, texts or lists (``K_p = [45, 15]`` sets ``K_p[1]`` and
    ``K_p[2]``). SSV: ``Parameter`` elements, whose units, if they have any, are converted.
    """
    return _ssv_values(file, controller) if file.suffix == ".ssv" else _table(file, read_toml(file).get("parameters"))


def _table(file: Path, table: Any) -> dict[str, Scalar]:
    if not isinstance(table, Mapping):
        raise InputError(f'{file} has no table [parameters] of lines like "K_p[1]" = 45.', "bad-parameters", file)
    for name, value in table.items():
        if value == []:
            raise InputError(f"{file}: the list of values of {name} is empty.", "bad-parameters", file, name)
        for element in value if isinstance(value, list) else [value]:
            if not isinstance(element, bool | int | float | str):
                message = f"{file}: the value of {name}, {element!r}, is neither a number nor true, false or a text."
                raise InputError(message, "bad-parameters", file, name)
    return elements(table)


def _ssv_values(file: Path, controller: Archive) -> dict[str, Scalar]:
    values: dict[str, Scalar] = {}
    root = _root(file)
    definitions = [_unit(file, unit) for unit in root.iterfind(".//{*}Units/{*}Unit")]
    for parameter in root.iterfind(".//{*}Parameter"):
        name = parameter.get("name", "")
        types = [child for child in parameter.iterchildren(etree.Element) if etree.QName(child).localname in SSV_TYPES]
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
        return float(value)
    except (TypeError, ValueError, OverflowError):
        message = f"{file}: the value of {name}, {value!r}, is not a number."
        raise InputError(message, "not-a-number", file, value) from None


def _root(file: Path) -> etree._Element:
    try:
        # No entities: a file of a stranger could read others by them ("XXE"), or grow to gigabytes.
        return etree.fromstring(read(file), etree.XMLParser(resolve_entities=False, no_network=True))
    except etree.XMLSyntaxError as problem:
        raise InputError(f"{file} is not a well-formed XML file: {problem}.", "bad-file", file) from None
