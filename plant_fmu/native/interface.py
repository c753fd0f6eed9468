"""What the tables of the Python plant say to the C sources: variables, ranges and the model description."""

from __future__ import annotations

from itertools import groupby
from xml.etree.ElementTree import Element, SubElement

from plant_fmu.flexible_manipulator.interface import AXES, VARIABLES, Variable, pair
from plant_fmu.flexible_manipulator.parameters import TABLE_1

SPEEDS: tuple[Variable, ...] = (
    *pair("w_a", "local", "rad/s", None, "link speed, derivative of q_a", AXES),
    *pair("w_m", "local", "rad/s", None, "motor speed, derivative of q_m", AXES),
)
"""States that are variables in Model Exchange only; their value references follow those of VARIABLES."""

STATES = ("q_a[1]", "q_a[2]", "q_m[1]", "q_m[2]", *(speed.name for speed in SPEEDS))
"""The continuous states of Model Exchange, in the order of the C sources."""

DERIVATIVES: tuple[Variable, ...] = tuple(
    Variable(f"der({state})", "local", "rad/s" if state[0] == "q" else "rad/s2", None, f"derivative of {state}")
    for state in STATES
)
"""Their derivatives, whose value references come last."""

_CAPABILITIES = (
    "canHandleVariableCommunicationStepSize",
    "canNotUseMemoryManagementFunctions",
    "canGetAndSetFMUstate",
    "canSerializeFMUstate",
)

_KINDS = {
    "input": {"variability": "continuous"},
    "output": {"variability": "continuous", "initial": "calculated"},
    "local": {"variability": "continuous", "initial": "calculated"},
    "parameter": {"variability": "fixed", "initial": "exact"},
    "calculatedParameter": {"variability": "fixed", "initial": "calculated"},
}


# ---- The model description ----


def description(model_exchange: bool) -> Element:
    """Return the FMI 2.0 description of the native plant, which the build completes and translates.

    For Model Exchange it also has the speeds and the derivatives of the states.
    """
    root = Element(
        "fmiModelDescription",
        fmiVersion="2.0",
        modelName="",
        guid="",
        description="Uncertain nonlinear two-link manipulator with elastic gear transmissions, in C "
        "(Moberg, Oehr, Gunnarsson, IFAC World Congress 2008)",
        variableNamingConvention="structured",
        numberOfEventIndicators="0",
    )
    SubElement(root, "CoSimulation", dict.fromkeys(_CAPABILITIES, "true"), modelIdentifier="")
    categories = SubElement(root, "LogCategories")
    SubElement(categories, "Category", name="logStatusError", description="Reasons of calls that failed")
    SubElement(root, "DefaultExperiment", startTime="0", stopTime="26", stepSize="0.00025")

    variables = (*VARIABLES, *SPEEDS, *DERIVATIVES) if model_exchange else VARIABLES
    indices = {variable.name: str(index) for index, variable in enumerate(variables, start=1)}
    listed = SubElement(root, "ModelVariables")
    for reference, variable in enumerate(variables):
        kind = {"causality": variable.causality, **_KINDS[variable.causality]}
        attributes = {"name": variable.name, "valueReference": str(reference), "description": variable.description}
        real = SubElement(SubElement(listed, "ScalarVariable", attributes | kind), "Real", unit=variable.unit)
        if variable.start is not None:
            real.set("start", repr(variable.start))
        if variable in DERIVATIVES:
            real.set("derivative", indices[variable.name[len("der(") : -1]])

    unknowns = {"Outputs": [variable.name for variable in VARIABLES if variable.causality == "output"]}
    if model_exchange:
        unknowns["Derivatives"] = [variable.name for variable in DERIVATIVES]
    structure = SubElement(root, "ModelStructure")
    for tag, names in unknowns.items():
        group = SubElement(structure, tag)
        for name in names:
            # In co-simulation the outputs follow from the state that a step has led to, and from nothing set since.
            known = (indices[other] for other in _arguments(name)) if model_exchange else ()
            SubElement(group, "Unknown", index=indices[name], dependencies=" ".join(sorted(known, key=int)))
    return root


def _arguments(name: str) -> tuple[str, ...]:
    """Names of the states and inputs that an output or a derivative is a function of."""
    axis = name.rstrip(")")[-2]
    return {
        "q_a": (name,),
        "q_m": (name,),
        "X": ("q_a[1]", "q_a[2]"),
        "der(q_a": (f"w_a[{axis}]",),
        "der(q_m": (f"w_m[{axis}]",),
        "der(w_a": (*STATES, "F[1]", "F[2]"),
        "der(w_m": tuple(f"{symbol}[{axis}]" for symbol in ("q_a", "q_m", "w_a", "w_m", "u_m", "u_d")),
    }[name.partition("[")[0]]


# ---- The header ----


def header() -> str:
    """Return the C header with the variables as a struct, their start values, and the ranges of Table 1."""
    groups = [(name, list(group)) for name, group in groupby(VARIABLES, lambda variable: variable.name.split("[")[0])]
    members = (f"    double {name}{_extent(group)}; /* [{group[0].unit}] */\n" for name, group in groups)
    starts = (f"    .{name} = {_starts(group)},\n" for name, group in groups)
    references = {variable.name: reference for reference, variable in enumerate(VARIABLES)}
    rows = (
        f'    {{{references[name]}, "{name}", "{row.unit}", "{row.description}", {str(row.positive).lower()}}},\n'
        for row in TABLE_1
        for name in row.names()
    )
    return f"""/* Written by the build from the tables of the Python plant. */
#ifndef INTERFACE_H
#define INTERFACE_H

#include <stdbool.h>

/* In the order of value references. */
typedef struct {{
{"".join(members)}}} Variables;

static const Variables START = {{
{"".join(starts)}}};

typedef struct {{
    unsigned reference;
    const char *name, *unit, *description;
    bool positive; /* zero is outside the physical range, as negative values always are */
}} Parameter;

static const Parameter TABLE_1[] = {{
{"".join(rows)}}};

#endif
"""


def _extent(group: list[Variable]) -> str:
    return f"[{len(group)}]" if "[" in group[0].name else ""


def _starts(group: list[Variable]) -> str:
    numbers = ", ".join(repr(variable.start or 0.0) for variable in group)
    return f"{{{numbers}}}" if _extent(group) else numbers
