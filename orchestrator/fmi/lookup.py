"""An FMU's variables by the names that a user gives, and the names nearest to one that does not exist."""

from __future__ import annotations

import difflib
from collections.abc import Iterable, Mapping

from fmpy.model_description import ModelDescription

from ..errors import InputError
from .variables import Variable, repeated_names, variables


def find_parameters(
    description: ModelDescription, given: Mapping[str, float], what: str
) -> dict[Variable, list[float]]:
    """Values of parameters given by name, scalars or single elements ``K_p[1]`` of arrays.

    Raises :class:`InputError` with the nearest names if a name is unknown or cannot be set.
    """
    known = variables(description)
    settable = {name: v for name, v in known.items() if v.is_real and v.causality == "parameter"}
    found: dict[Variable, list[float]] = {}
    for name, value in given.items():
        base, _, index = name.rstrip("]").partition("[")
        if twofold := {name, base} & repeated_names(description):
            message = f"{what} has more than one variable {min(twofold)}, so none of them is set."
            raise InputError(f"{message} Export the FMU again.", "not-settable", what, name)
        if name in settable and settable[name].size == 1:
            found[settable[name]] = [value]
        elif base in settable and index.isdigit() and 1 <= int(index) <= settable[base].size:
            array = settable[base]
            found.setdefault(array, list(array.start) or [0.0] * array.size)[int(index) - 1] = value
        elif name in settable:
            size = settable[name].size
            message = f"{what}: {name} is a parameter of {size} elements: give {name}[1]={value:g} and so on."
            raise InputError(message, "array-parameter", what, name, (f"{name}[{i}]" for i in range(1, size + 1)))
        elif name in known:
            kind = f"{known[name].type} {known[name].causality}"
            message = f"{what}: {name} is declared as {kind} and cannot be set: only real parameters can."
            raise unknown(message, "not-settable", what, name, settable)
        else:
            raise unknown(f"{what} has no parameter {name}.", "no-parameter", what, name, settable)
    return found


def find_outputs(description: ModelDescription, names: Iterable[str], what: str) -> list[Variable]:
    """The scalar real outputs called ``names``; raises :class:`InputError` with the nearest if one is unknown."""
    known = {
        name: v for name, v in variables(description).items() if v.is_real and v.size == 1 and v.causality == "output"
    }
    for name in names:
        if name not in known:
            raise unknown(f"{what} has no output {name}.", "no-output", what, name, known)
    return [known[name] for name in names]


def unknown(message: str, what: str, where: str, name: str, names: Iterable[str]) -> InputError:
    """An error about ``name``, with the up to four ``names`` that look most like it, else the first eight."""
    pool = list(names)
    nearest = difflib.get_close_matches(name, pool, 4, 0.3) or pool[:8]
    return InputError(f"{message} Nearest: {', '.join(nearest) or 'none'}.", what, where, name, nearest)
