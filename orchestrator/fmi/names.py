"""How exporters spell ``q_m[1]``: from a variable's name to the connector and component it may stand for."""

from __future__ import annotations

import re
from dataclasses import dataclass

ARRAY = -1
"""Index of a whole array."""


COLUMN = re.compile(r"[\[(](\d+)(?:, ?|\]\[|\)\()[01][\])]$")
"""Indices of an element in a matrix's only column, which is the first, counted from 1 or 0."""


@dataclass(frozen=True)
class Spelling:
    """``base`` is a name without case and punctuation ("qm"), ``index`` the component's digit, ARRAY for an array."""

    base: str
    index: int


def spelling(name: str, array: bool) -> Spelling | None:
    """A variable's name apart from its spelling; None if it cannot be a component.

    ``q_m[1]``, ``q_m_1``, ``q_m1``, ``qm1``, ``q_m.axis1`` and ``Controller.q_m[1]`` all become ("qm", 1), and so do
    the elements of a matrix of one column, ``q_m[1,1]``, ``q_m[1][1]`` and ``q_m(1,1)``. The name of an ``array`` has
    no index. Enclosing components ("Controller.") do not count.
    """
    parts = name.split(".")
    local = COLUMN.sub(r"[\1]", parts[-1])
    if len(parts) > 1 and re.fullmatch(r"(?:axis|joint)?_?\d", local.lower()):
        local = parts[-2] + "_" + local
    words = re.findall(r"[a-z]+|\d+", local.lower())
    if array:
        return Spelling("".join(words), ARRAY)
    if not words or not words[-1].isdigit():
        return None
    number = words.pop()
    if words and words[-1] in ("axis", "joint"):
        words.pop()
    base = "".join(words) + number[:-1]
    return Spelling(base, int(number[-1])) if base else None


def canonical(name: str) -> str:
    """The ``base`` of a connector's own name: ``q_m_ref`` is "qmref"."""
    return "".join(re.findall(r"[a-z]+|\d+", name.lower()))
