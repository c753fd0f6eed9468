"""The PID in C under other names, units, types and timings; cheap, because most share one binary."""

from functools import partial
from pathlib import Path
from typing import Any

from support.pid_fmus import built

from controller_fmu.export import Dialect
from orchestrator.loop.behaviour import Convention

from .description_edits import Edit, declare, edited, rename, unit, without_units
from .native import DEGREE, CModel
from .recipe import Recipe


def _described(name: str, *edits: Edit) -> Recipe:
    def make(target: Path) -> Path:
        return edited(built("DiagonalPID_C", target.parent), target, *edits)

    return Recipe(name, make, needs=("compiler",))


def _c_model(target: Path, model: CModel, edits: tuple[Edit, ...]) -> Path:
    return edited(model.build(target), target, *edits)


def _compiled(name: str, model: CModel, *edits: Edit, **expected: Any) -> Recipe:
    make = partial(_c_model, model=model, edits=edits)
    return Recipe(name, make, needs=("compiler",), convention=model.convention, **expected)


_INDEX = r"\[(\d)\]"

RECIPES = (
    _described("names_underscore", rename(_INDEX, r"_\1")),
    _described("names_joined", rename(_INDEX, r"\1")),
    _described("names_nested", rename("^", "Controller.")),
    _described(
        "position_error",
        rename("q_m_ref", "e"),
        rename("q_m", "unused"),
        declare("unused.*", causality="parameter", variability="fixed"),
    ),
    _described("no_units", without_units),
    _compiled(
        "degrees_and_millinewton",
        CModel(angle=DEGREE, torque=1e-3),
        unit("rad", "deg", rad="1", factor=repr(DEGREE)),
        unit("N.m", "mN.m", kg="1", m="2", s="-2", factor="0.001"),
        tolerance=1e-12,  # the conversions round
    ),
    _compiled(
        "float32_arrays",
        CModel(dialect=Dialect(3, arrays=True, float_bits=32)),
        tolerance=2.0**-24,  # the output is rounded to single precision
    ),
    _compiled("timing_initialization", CModel(convention=Convention.INITIALIZATION)),
    _compiled("timing_twice_first", CModel(convention=Convention.TWICE)),
)

_THREE_AXES = (0, 1, 1)

REFUSED = (
    _described("refused_integer", declare(r"q_m\[.\]", "Integer", variability="discrete")),
    _described("refused_two_candidates", rename(r"^q_m\[", "Controller.q_m["), rename("q_m_ref", "Observer.q_m")),
    _described("refused_missing_output", rename(r"^u_m\[", "y[")),
    _described("refused_missing_second_output", rename(r"^u_m\[2\]", "y")),
    _described("refused_wrong_unit", unit("rad", "m", m="1")),
    _compiled("refused_three_axes", CModel(axes=_THREE_AXES)),
    _compiled("refused_arrays_of_three", CModel(axes=_THREE_AXES, dialect=Dialect(3, arrays=True))),
)
