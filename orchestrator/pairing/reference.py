"""The benchmark's own controllers as the references of others: in C where that can be, which is faster."""

from __future__ import annotations

from dataclasses import replace

from build_fmus import find_compiler

from ..errors import InputError
from .controller import Controller

IN_C = {
    "DiagonalPID": "DiagonalPID_C",
    "TunedPID": "DiagonalPID_C",
    "DitheredLQG": "DitheredLQG_C",
    "ManipulatorLQG": "",
}
"""The references, each with the FMU in C that can take its place: the same to the last bit for the PIDs, up to rounding
for the LQG."""


def reference(name: str) -> Controller:
    """The controller called ``name``; raises :class:`InputError` for one that is none of :data:`IN_C`."""
    if name not in IN_C:
        raise InputError(f"No reference is named {name}. There are: {', '.join(IN_C)}.", "no-reference", "", name, IN_C)
    own = Controller.built_in(name)
    return in_c(own, Controller.built_in(IN_C[name])) if IN_C[name] and find_compiler() is not None else own


def in_c(own: Controller, twin: Controller) -> Controller:
    """The controller ``twin`` with the parameters that ``own`` begins with."""
    common = _starts(twin)
    changes = {key: value for key, value in _starts(own).items() if value != common.get(key, value)}
    return replace(twin, parameters=changes)


def _starts(controller: Controller) -> dict[str, float]:
    variables = controller.archive.description.modelVariables
    return {each.name: float(each.start) for each in variables if each.causality == "parameter"}
