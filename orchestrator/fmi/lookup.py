"""An FMU's variables by the names that a user gives, and the names nearest to one that does not exist."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from typing import Any

from fmpy.model_description import ModelDescription

from ..codec import Scalar
from ..errors import InputError, unknown
from .values import check_limits, typed
from .variables import Variable, repeated_names, variables

_MISSING: Any = object()
"""An element of an array that has no value yet."""


def find_values(
    description: ModelDescription, given: Mapping[str, Scalar], what: str, driven: Collection[Variable] = ()
) -> dict[Variable, list[Scalar]]:
    """Values of parameters and inputs given by name, scalars or single elements ``K_p[1]`` of arrays, as their types
    take them. Elements of an array that are not given keep their start values.

    Raises :class:`InputError` with the nearest names if a name is unknown or cannot be set, also for an input that is
    ``driven``, which would not keep the value; and as :func:`.typed` and :func:`.check_limits`.
    """
    values: dict[Variable, list[Scalar]] = {}
    for name, value in given.items():
        variable, element = place(description, name, what)
        # The loop overwrites it in the first sample: the user would take the score for one with the value.
        if variable in driven:
            message = f"{what}: {name} cannot be set: it is an input that the benchmark drives."
            settable = [other.name for other in variables(description).values() if other.can_be_set]
            raise unknown(message, "not-settable", what, name, [other for other in settable if other != name])
        elements = values.setdefault(variable, list(variable.start) or [_MISSING] * variable.size)
        elements[element] = typed(variable, value, what)
        check_limits(variable, elements[element], what)
    for variable, elements in values.items():
        # FMI has no default for an array without start values. Zeros would be a
        # choice of ours, and the result would be named after the given ones.
        if _MISSING in elements:
            name = f"{variable.name}[{elements.index(_MISSING) + 1}]"
            message = f"{what}: {name} has neither a value nor a start value. Give all elements of {variable.name}."
            raise InputError(message, "array-parameter", what, name)
    return values


def canonical_values(description: ModelDescription, given: Mapping[str, Scalar], what: str) -> dict[str, Scalar]:
    """The same by the names that were given: the one form of these values that is recorded and told apart."""
    return {name: typed(place(description, name, what)[0], value, what) for name, value in given.items()}


def place(description: ModelDescription, name: str, what: str) -> tuple[Variable, int]:
    """The variable that can be set by ``name``, and the number of the element that it stands for, from 0."""
    by_name = variables(description)
    base, _, index = name.rstrip("]").partition("[")
    # As for connectors: to set one of two variables of a name would be a guess.
    if twofold := {name, base} & repeated_names(description):
        message = f"{what} has more than one variable {min(twofold)}, so none of them is set."
        raise InputError(f"{message} Export the FMU again.", "not-settable", what, name)
    variable = by_name.get(name)
    if variable is not None and variable.can_be_set and variable.size == 1:
        return variable, 0
    array = by_name.get(base)
    if array is not None and array.can_be_set and index.isdecimal() and 1 <= int(index) <= array.size:
        return array, int(index) - 1
    if variable is not None and variable.can_be_set:
        size = variable.size
        message = f"{what}: {name} has {size} elements: give {name}[1] and so on."
        raise InputError(message, "array-parameter", what, name, (f"{name}[{i}]" for i in range(1, size + 1)))
    settable = [name for name, one in by_name.items() if one.can_be_set]
    if variable is not None:
        message = (
            f"{what}: {name} is declared as {variable.type} {variable.causality} and cannot be set: only parameters "
        )
        raise unknown(f"{message}and inputs can.", "not-settable", what, name, settable)
    raise unknown(f"{what} has no parameter or input {name}.", "no-parameter", what, name, settable)


def elements(
    values: Mapping[str, Scalar | Sequence[Scalar]], description: ModelDescription | None = None, where: str = ""
) -> dict[str, Scalar]:
    """``values`` with those of an array by element: ``K_p = [45, 15]`` gives ``K_p[1]`` and ``K_p[2]``.

    Raises :class:`InputError` for an element that is given twice, of which one value was lost, for an empty list, and
    for one that is shorter than the array in the ``description``, if that is known.
    """
    listed: dict[str, Scalar] = {}
    begin = f"{where or 'The parameters'}: "
    for name, value in values.items():
        single = isinstance(value, bool | int | float | str)
        given = {name: value} if single else {f"{name}[{i}]": element for i, element in enumerate(value, start=1)}  # type: ignore[arg-type]
        if not given:
            raise InputError(f"{begin}the list of values of {name} is empty.", "bad-parameters", where, name)
        for element in given:
            if element in listed:
                raise InputError(f"{begin}{element} is given more than once.", "repeated", where, element)
        size = 0 if single or description is None else _size(description, name)
        if len(given) < size:
            message = f"{begin}{name} has {size} elements, and {len(given)} are given. Give all, or those to be changed"
            raise InputError(f"{message} by their names, such as {name}[1].", "array-parameter", where, name)
        listed.update(given)  # type: ignore[arg-type]  # a scalar, or elements of a list
    return listed


def _size(description: ModelDescription, name: str) -> int:
    """The number of elements that ``name`` has, as an array or as scalars ``name[1]``, ``name[2]``, ..."""
    declared = variables(description)
    if name in declared:
        return declared[name].size
    size = 0
    while f"{name}[{size + 1}]" in declared:
        size += 1
    return size


def find_outputs(description: ModelDescription, names: Iterable[str], what: str) -> list[Variable]:
    """The scalar real outputs called ``names``; raises :class:`InputError` with the nearest if one is unknown."""
    outputs = {
        name: v for name, v in variables(description).items() if v.is_real and v.size == 1 and v.causality == "output"
    }
    for name in names:
        if name not in outputs:
            raise unknown(f"{what} has no output {name}.", "no-output", what, name, outputs)
    return [outputs[name] for name in names]
