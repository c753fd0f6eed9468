"""Value references of a model in C: what the description declares, held against what the built library has."""

from __future__ import annotations

import json
import math
import sys
from pathlib import Path
from xml.etree.ElementTree import Element

from controller_fmu.errors import CompilerError, DescriptionError, ValueReferenceError
from controller_fmu.export.compiler import run_compiler
from controller_fmu.export.description import array_name, variables

REMEDY = "a valueReference is the variable's place in the model's struct, counted in doubles from 0"

# In a process of its own, because a model may crash, and because a library cannot be unloaded for certain.
_ASK = """
import ctypes, json, sys
library, answer = sys.argv[1:]
library = ctypes.CDLL(library)
size, count = (ctypes.c_size_t.in_dll(library, name).value for name in ("model_size", "model_variables"))
model = (ctypes.c_double * max(-(-size // 8), count))()
library.model_start(model)
with open(answer, "w") as file:
    json.dump(model[:count], file)
"""


def check_declared(root: Element, arrays: bool) -> None:
    """Raise :class:`ValueReferenceError` if a reference of the description is not a number, or is there twice.

    With ``arrays`` also if the references of the elements of an array do not follow each other.
    """
    owners: dict[int, str] = {}
    for variable in variables(root):
        name, reference = variable.attrib["name"], variable.get("valueReference", "")
        if not (reference.isascii() and reference.isdigit()):
            what = f"the valueReference of {name!r} is {reference!r}, which is not a number"
            raise ValueReferenceError(what, value=reference, remedy=REMEDY)
        owner = owners.setdefault(int(reference), name)
        if owner != name:
            what = f"{owner!r} and {name!r} both have the valueReference {reference}"
            raise ValueReferenceError(what, value=reference, remedy=REMEDY)
    if arrays:
        _check_arrays(root)


def check_model(library: Path, root: Element) -> None:
    """Hold the scalars of the description ``root`` against the model in ``library``.

    Each variable of the model must be declared, each declared one exist and start with the declared value, up to
    rounding. Variables of equal start values that were mixed up cannot be noticed.

    Args:
        library: the compiled model; it is loaded into another process.
        root: the description, FMI 2.0 with scalars.

    Raises:
        ValueReferenceError: they disagree; the fields name the reference.
        CompilerError: the library cannot be asked.
    """
    declared = {int(variable.attrib["valueReference"]): variable for variable in variables(root)}
    starts = _starts(library)
    _check_places(declared, len(starts))
    for reference, variable in declared.items():
        _check_start(reference, variable, starts[reference])


def _starts(library: Path) -> list[float]:
    """The model's start values by value reference."""
    answer = library.with_name("answer.json")
    try:
        run_compiler([sys.executable, "-I", "-S", "-c", _ASK, str(library.resolve()), str(answer.resolve())], answer)
    except CompilerError as problem:
        raise CompilerError(f"the built model cannot be asked for its variables\n{problem}") from None
    starts: list[float] = json.loads(answer.read_text())
    return starts


def _check_arrays(root: Element) -> None:
    arrays: dict[str, dict[int, str]] = {}
    for variable in variables(root):
        arrays.setdefault(array_name(variable), {})[int(variable.attrib["valueReference"])] = variable.attrib["name"]
    for name, elements in arrays.items():
        if list(elements) != list(range(min(elements), min(elements) + len(elements))):
            what = f"the elements of {name!r} do not follow each other: valueReferences {', '.join(map(str, elements))}"
            raise ValueReferenceError(what, value=str(min(elements)), remedy=REMEDY)


def _check_places(declared: dict[int, Element], count: int) -> None:
    free = tuple(str(reference) for reference in range(count) if reference not in declared)
    last = max(declared, default=-1)
    if last >= count:
        what = f"{declared[last].attrib['name']!r} has the valueReference {last}, but the model has {count} variables"
        raise ValueReferenceError(what, value=str(last), nearest=free, remedy=REMEDY)
    if free:
        what = f"the model has {count} variables, and no ScalarVariable has the valueReference {free[0]}"
        remedy = "declare the variable, or correct the constant model_variables"
        raise ValueReferenceError(what, value=free[0], remedy=remedy)


def _check_start(reference: int, variable: Element, value: float) -> None:
    name, real = variable.attrib["name"], variable.find("Real")
    start = None if real is None else real.get("start")
    if start is None:
        return
    try:
        agrees = math.isclose(float(start), value, rel_tol=1e-6)
    except ValueError:
        raise DescriptionError(f"the start value {start!r} of {name!r} is not a number", value=start) from None
    if not agrees:
        what = f"{name!r} starts at {start}, but the variable at its valueReference {reference} starts at {value:g}"
        raise ValueReferenceError(what, value=str(reference), remedy=REMEDY)
