"""Which names and values a file may hold at the place where it is wrong."""

from __future__ import annotations

import re

from msgspec import inspect


def allowed(problem: str, kind: type) -> str:
    """The names or values that a ``kind`` allows at the place that ``problem``, a message of msgspec, tells; empty if
    they are not a list."""
    place = re.search(r" - at `\$(.*)`$", problem)
    found = _at(inspect.type_info(kind), place[1] if place else "")
    if isinstance(found, inspect.StructType) and "unknown field" in problem:
        return ", ".join(field.name for field in found.fields)
    if isinstance(found, inspect.LiteralType):
        return ", ".join(map(str, found.values))
    return ""


def _at(kind: inspect.Type, path: str) -> inspect.Type | None:
    """The type at a ``path`` such as ``.tests[0].sweep`` below ``kind``; None if there is none."""
    found: inspect.Type | None = kind
    for name, _ in re.findall(r"\.(\w+)|(\[[^]]*\])", path):
        if isinstance(found, inspect.StructType) and name:
            found = next((field.type for field in found.fields if field.name == name), None)
        elif isinstance(found, inspect.DictType):
            found = found.value_type
        elif isinstance(found, inspect.VarTupleType):
            found = found.item_type
        else:
            return None
    return found
