"""Controllers of the benchmark as FMUs, and what turns sources, matrices and networks into FMUs."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from controller_fmu.export.mlp import controller_from_mlp
    from controller_fmu.export.state_space import controller_from_state_space

__all__ = ["controller_from_mlp", "controller_from_state_space"]


def __getattr__(name: str) -> Any:
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    # when first used: the packages of the builders take a second
    return getattr(import_module(f"controller_fmu.export.{name.removeprefix('controller_from_')}"), name)
