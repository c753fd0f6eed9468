"""The compiled FMUs that get random calls, each by what builds it in a folder."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

import build_fmus
from controller_fmu import controller_from_mlp, controller_from_state_space

LQGS = ("DitheredLQG_C", "RobustLQG", "RobustLinearLQG", "SteadyLQG")


def _state_space(folder: Path) -> Path:
    """A schedule of three controllers with two states, linearly interpolated."""
    chance = np.random.default_rng(1)
    A = np.array([np.diag(chance.uniform(-0.9, 0.9, 2)) for _ in range(3)])
    B, C, D = (chance.normal(size=(3, 2, 2)) for _ in range(3))
    points = [(0.0, 0.0), (100.0, 0.0), (0.0, 100.0)]
    out = folder / "LinearSchedule.fmu"
    schedule = {"points": points, "interpolation": "linear", "anti_windup": B}
    return controller_from_state_space(A, B, C, D, 0.25e-3, out=out, **schedule)


def _mlp(folder: Path, activation: str) -> Path:
    chance = np.random.default_rng(2)
    sizes = (8, 6, 2)
    weights = {f"W{k}": chance.normal(size=(sizes[k], sizes[k - 1])) for k in (1, 2)}
    weights |= {f"b{k}": chance.normal(size=sizes[k]) for k in (1, 2)}
    return controller_from_mlp({**weights, "activation": activation}, out=folder / f"Network_{activation}.fmu")


def _starter(folder: Path, dialect: build_fmus.Dialect) -> Path:
    """The starter kit in C, with variables in single precision."""
    kit = build_fmus.HERE / "controller_fmu" / "starters" / "c"
    return build_fmus.c_fmu(sorted(kit.glob("*.c")), kit / "modelDescription.xml", folder / "Starter.fmu", dialect)


FMUS: dict[str, Callable[[Path], Path]] = {
    name: partial(build_fmus.build, name)
    for name in (
        *("FlexibleManipulatorNative", *build_fmus.PLANT_VARIANTS),
        *("DiagonalPID_C", *build_fmus.VARIANTS),
        *(*LQGS, "Imperfections"),
    )
}
FMUS |= {
    "state_space": _state_space,
    "mlp_tanh": partial(_mlp, activation="tanh"),
    "mlp_relu": partial(_mlp, activation="relu"),
    "starter_fmi3_float32": partial(_starter, dialect=build_fmus.Dialect(3, arrays=True, float_bits=32)),
}
