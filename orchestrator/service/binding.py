"""From a form to the mapping file that the command line takes, and which form a file was made with."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence

from ..codec import Scalar
from ..errors import InputError
from .records import ConnectorRecord, Interface, VariableRecord

REAL = ("Real", "Float64", "Float32")

MAX_BINDING = 64 * 1024
"""Longest binding [bytes]: each look at its run shows it."""

MAX_VALUE = 10_000
"""Longest text of a value."""


NUMBER = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)


def components(connector: ConnectorRecord) -> tuple[str, str]:
    """What a mapping calls its two parts."""
    return f"{connector.name}[1]", f"{connector.name}[2]"


def candidates(interface: Interface, connector: ConnectorRecord) -> list[VariableRecord]:
    """The variables that a connector could be bound to: single ones, and arrays of two."""
    return [
        variable
        for variable in interface.variables
        if variable.causality in connector.causalities and variable.type in REAL and variable.size in (1, 2)
    ]


def values(interface: Interface) -> list[VariableRecord]:
    """The variables that may be given a value: parameters, and inputs that no connector is bound to now."""
    taken = {name for connector in interface.connectors for name in connector.bound}
    return [
        variable
        for variable in interface.variables
        if variable.causality in ("parameter", "input") and variable.name not in taken
    ]


def mapping_file(interface: Interface, chosen: Mapping[str, str], given: Mapping[str, str]) -> str:
    """The text of the mapping file: ``chosen`` are variables by part of a connector, ``given`` values by variable, as
    they were typed; empty ones are left out.

    Only names of this ``interface`` get into it. Raises :class:`InputError` for another one, for a connector of which
    one part is missing, and for a variable that was chosen twice.
    """
    by_name = {variable.name: variable for variable in interface.variables}
    mapping: dict[str, str] = {}
    for connector in interface.connectors:
        first, second = (chosen.get(part, "") for part in components(connector))
        for name in filter(None, (first, second)):
            if name not in by_name:
                raise InputError(f"The FMU has no variable {name}.", "no-variable", "", name)
        if first and by_name[first].size == 2:
            if second:
                message = f"{first} is an array of both axes: leave the second field of {connector.name} empty."
                raise InputError(message, "bad-mapping", "", connector.name)
            mapping[connector.name] = first
        elif first and second:
            mapping |= zip(components(connector), (first, second), strict=True)
        elif first or second:
            message = f"{connector.name} has two axes: choose a variable for each, or an array of two."
            raise InputError(message, "bad-mapping", "", connector.name)
    if len(set(mapping.values())) < len(mapping):
        names = list(mapping.values())
        twice = next(name for name in names if names.count(name) > 1)
        raise InputError(f"{twice} is chosen twice. Choose another variable for each field.", "bad-mapping", "", twice)
    parameters = {}
    for name, text in given.items():
        if name not in by_name:
            raise InputError(f"The FMU has no variable {name}.", "no-variable", "", name)
        if text.strip() and name not in mapping.values():
            parameters[name] = _value(by_name[name], text.strip())
    return written(mapping, parameters)


def written(mapping: Mapping[str, str], parameters: Mapping[str, Scalar | Sequence[Scalar]]) -> str:
    """A mapping file with these tables; empty if both are. Raises :class:`InputError` if it were too large."""
    too_large = InputError(f"A binding of more than {MAX_BINDING / 1e3:.0f} kB is not taken here.", "file-limit")
    # Before it is written, letter by letter: one name of 8 MB would keep the whole service waiting for 11 s.
    entries = len(mapping) + len(parameters)
    if (
        ENTRY * entries + sum(map(_size, (*mapping, *mapping.values(), *parameters, *parameters.values())))
        > MAX_BINDING
    ):
        raise too_large
    lines = ["[map]", *(f"{_toml(name)} = {_toml(variable)}" for name, variable in mapping.items())]
    if parameters:
        lines += ["", "[parameters]", *(f"{_toml(name)} = {_toml(value)}" for name, value in parameters.items())]
    if not mapping and not parameters:
        return ""
    text = "\n".join(lines) + "\n"
    if len(text.encode()) > MAX_BINDING:
        raise too_large
    return text


ENTRY = len('"" = \n')
"""Letters of an entry beside its name and value, at the least."""


def _size(value: Scalar | Sequence[Scalar]) -> int:
    """The least number of letters that a value takes."""
    if isinstance(value, str):
        return len(value)
    if isinstance(value, bool | int | float):
        return 1
    between = 2 * len(value)  # ", " and brackets
    return between if between > MAX_BINDING else between + sum(map(_size, value))


def _value(variable: VariableRecord, text: str) -> Scalar | Sequence[Scalar]:
    if len(text) > MAX_VALUE:
        raise InputError(f"The value of {variable.name} is too long.", "bad-value", "", variable.name)
    if variable.size > 1:
        return [_scalar(variable, part.strip()) for part in re.split(r"[,;\s]+", text) if part.strip()]
    return _scalar(variable, text)


def _scalar(variable: VariableRecord, text: str) -> Scalar:
    """A typed value. What it may be, the check says: a text that is no number goes on as it is."""
    if variable.type == "Boolean" and text.lower() in ("true", "false"):
        return text.lower() == "true"
    if variable.type in REAL and NUMBER.fullmatch(text):
        return float(text)
    return int(text) if re.fullmatch(r"-?\d{1,18}", text, re.ASCII) and variable.type not in REAL else text


def _toml(value: Scalar | Sequence[Scalar]) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, int | float):
        return repr(value)
    if isinstance(value, str):
        return '"' + "".join(map(_escaped, value)) + '"'
    return f"[{', '.join(map(_toml, value))}]"


def _escaped(character: str) -> str:
    if character in '"\\':
        return f"\\{character}"
    return character if character.isprintable() else f"\\U{ord(character):08x}"
