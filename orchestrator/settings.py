"""Files that say how a controller is used: connector mappings (TOML, SSP's SSM) and parameters (TOML, SSP's SSV)."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from lxml import etree

from .errors import InputError

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib


def read_mapping(file: Path) -> dict[str, str]:
    """Connector to FMU variable. TOML: a table ``[map]`` of ``"q_m[1]" = "In1"``. SSM: ``MappingEntry`` elements."""
    if file.suffix == ".ssm":
        entries = _root(file).iterfind(".//{*}MappingEntry")
        return {entry.get("target", ""): entry.get("source", "") for entry in entries}
    table = _toml(file).get("map")
    if not isinstance(table, Mapping) or not all(isinstance(value, str) for value in table.values()):
        raise InputError(f'{file} has no table [map] of lines like "q_m[1]" = "In1".')
    return dict(table)


def read_parameters(file: Path) -> dict[str, float]:
    """Parameter name to value. TOML: a table ``[parameters]`` of numbers or lists (``K_p = [45, 15]`` sets ``K_p[1]``
    and ``K_p[2]``). SSV: ``Parameter`` elements of type Real or Integer."""
    if file.suffix == ".ssv":
        return {
            parameter.get("name", ""): _number(file, parameter.get("name", ""), value.get("value"))
            for parameter in _root(file).iterfind(".//{*}Parameter")
            for value in parameter
            if etree.QName(value).localname in ("Real", "Integer")
        }
    table = _toml(file).get("parameters")
    if not isinstance(table, Mapping):
        raise InputError(f'{file} has no table [parameters] of lines like "K_p[1]" = 45.')
    values: dict[str, float] = {}
    for name, value in table.items():
        if isinstance(value, list):
            values.update({f"{name}[{i}]": _number(file, name, element) for i, element in enumerate(value, start=1)})
        else:
            values[name] = _number(file, name, value)
    return values


def _number(file: Path, name: str, value: Any) -> float:
    try:
        if isinstance(value, bool):
            raise TypeError
        return float(value)
    except (TypeError, ValueError):
        raise InputError(f"{file}: the value of {name}, {value!r}, is no number.") from None


def _toml(file: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(file.read_text(encoding="utf-8"))
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as problem:
        raise InputError(f"{file} is no TOML file: {problem}.") from None


def _root(file: Path) -> etree._Element:
    try:
        return etree.parse(str(file), etree.XMLParser(resolve_entities=False, no_network=True)).getroot()
    except OSError as problem:
        raise InputError(f"{file} cannot be read: {problem}.") from None
    except etree.XMLSyntaxError as problem:
        raise InputError(f"{file} is no well-formed XML file: {problem}.") from None
