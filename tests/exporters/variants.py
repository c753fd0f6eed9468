"""The PID in C under other names, units, types and timings; cheap, because most share one binary."""

from __future__ import annotations

import tempfile
from dataclasses import fields
from functools import partial
from pathlib import Path
from typing import Any

import build_fmus
from controller_fmu.export import Dialect

from .description_edits import Edit, declare, edited, rename, retype, unit, without_units
from .native import DEGREE, CModel
from .recipe import ARRAYS, Ports, Recipe, Timing


def variant(target: Path, edits: tuple[Edit, ...], base: str = "DiagonalPID_C") -> Path:
    """Build ``base``, a name build_fmus knows, and write it to ``target`` with its description edited."""
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        return edited(build_fmus.build(base, Path(folder)), target, *edits)


def _c_model(target: Path, model: CModel, edits: tuple[Edit, ...]) -> Path:
    return edited(model.build(target), target, *edits)


def _ports(template: str, **renamed: str) -> Ports:
    """Return ports named after ``template``, in which {name} and {axis} are replaced."""
    names = {**{port.name: port.name for port in fields(Ports)}, **renamed}
    return Ports(
        **{port: tuple(template.format(name=name, axis=axis) for axis in (1, 2)) for port, name in names.items()}
    )


def _described(name: str, *edits: Edit, base: str = "DiagonalPID_C", **expected: Any) -> Recipe:
    return Recipe(name, partial(variant, edits=edits, base=base), needs_compiler=True, **expected)


def _compiled(name: str, model: CModel, *edits: Edit, **expected: Any) -> Recipe:
    make = partial(_c_model, model=model, edits=edits)
    return Recipe(name, make, needs_compiler=True, timing=model.timing, **expected)


_INDEX = r"\[(\d)\]"

RECIPES = (
    _described("names_underscore", rename(_INDEX, r"_\1"), ports=_ports("{name}_{axis}")),
    _described(
        "names_underscore_fmi3",
        rename(_INDEX, r"_\1"),
        base="DiagonalPID_C_fmi3_scalars",
        ports=_ports("{name}_{axis}"),
    ),
    _described("names_joined", rename(_INDEX, r"\1"), ports=_ports("{name}{axis}")),
    _described(
        "names_bare",
        rename(_INDEX, r"\1"),
        rename("_", ""),
        ports=_ports("{name}{axis}", q_m_ref="qmref", q_m="qm", u_m="um", u_m0="um0"),
    ),
    _described("names_member", rename(_INDEX, r".axis\1"), ports=_ports("{name}.axis{axis}")),
    _described("names_nested", rename("^", "Controller."), ports=_ports("Controller.{name}[{axis}]")),
    _described(
        "position_error",
        rename("q_m_ref", "e"),
        rename("q_m", "unused"),
        declare("unused.*", causality="parameter", variability="fixed"),
        ports=_ports("{name}[{axis}]", q_m_ref="e", q_m="unused"),
    ),
    _described("no_units", without_units),
    _compiled(
        "degrees_and_millinewton",
        CModel(angle=DEGREE, torque=1e-3),
        unit("rad", "deg", rad="1", factor=repr(DEGREE)),
        unit("N.m", "mN.m", kg="1", m="2", s="-2", factor="0.001"),
        angle_unit=DEGREE,
        torque_unit=1e-3,
        tolerance=1e-12,  # the conversions round
    ),
    _compiled(
        "float32_arrays",
        CModel(dialect=Dialect(3, arrays=True, float_bits=32)),
        ports=ARRAYS,
        tolerance=2.0**-24,  # the output is rounded to single precision
    ),
    _compiled("timing_initialization", CModel(timing=Timing.INITIALIZATION)),
    _compiled("timing_twice_first", CModel(timing=Timing.TWICE_FIRST)),
)

_THREE_AXES = (0, 1, 1)

REFUSED = (
    _described("refused_integer", retype(r"q_m\[.\]", "Integer"), refused="q_m is an Integer"),
    _described(
        "refused_two_candidates",
        rename(r"^q_m\[", "Controller.q_m["),
        rename("q_m_ref", "Observer.q_m"),
        refused="two inputs could be q_m",
    ),
    _described("refused_missing_output", rename(r"^u_m\[", "y["), refused="no output is named u_m"),
    _described("refused_missing_second_output", rename(r"^u_m\[2\]", "y"), refused="no output is named u_m[2]"),
    _described("refused_wrong_unit", unit("rad", "m", m="1"), refused="q_m is a length"),
    _compiled("refused_three_axes", CModel(axes=_THREE_AXES), refused="q_m has three elements"),
    _compiled(
        "refused_arrays_of_three",
        CModel(axes=_THREE_AXES, dialect=Dialect(3, arrays=True)),
        refused="q_m is an array of three",
    ),
)
