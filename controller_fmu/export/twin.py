"""A twin in C of an FMU in Python: it is described as that one is, and its header follows from the description."""

from __future__ import annotations

from itertools import groupby
from xml.etree.ElementTree import Element

from controller_fmu.export.description import array_name, variables


def twin_description(root: Element) -> Element:
    """Change the FMI 2.0 description ``root`` of a Python FMU in place to that of its twin in C; return it."""
    for interface in root.iterfind("CoSimulation"):
        interface.set("needsExecutionTool", "false")
    return root


def twin_header(root: Element) -> str:
    """Return the C header with the variables as a struct, their start values, and the parameters' ranges.

    Elements of an array follow each other, as do the value references.
    """
    members = []
    for name, group in groupby(variables(root), array_name):
        reals = [_real(variable) for variable in group]
        members.append(f"    double {name}{f'[{len(reals)}]' if len(reals) > 1 else ''}; /* [{reals[0]['unit']}] */\n")
    starts = ", ".join(_real(variable).get("start", "0.0") for variable in variables(root))
    ranges = (
        f'    {{{variable.attrib["valueReference"]}, "{variable.attrib["name"]}", "{real["unit"]}", {real["min"]}}},\n'
        for variable in variables(root)
        if "min" in (real := _real(variable))
    )
    return f"""/* Written by the build from the description of the FMU in Python. */
#ifndef INTERFACE_H
#define INTERFACE_H

/* In the order of value references. */
typedef struct {{
{"".join(members)}}} Variables;

static const double START[] = {{{starts}}};

typedef struct {{
    unsigned reference;
    const char *name, *unit;
    double least;
}} Range;

static const Range RANGES[] = {{
{"".join(ranges)}}};

#endif
"""


def _real(variable: Element) -> dict[str, str]:
    return variable.find("Real").attrib  # type: ignore[union-attr]  # Python FMUs have reals only
