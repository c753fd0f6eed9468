"""The benchmark's two-axis PID, eq. (12)-(13), as other exporters make it: ``RECIPES[name].build(folder)``."""

from . import casadi_pid, containers, python_tools, rumoca_pid, variants
from .recipe import Recipe, built

__all__ = ["RECIPES", "REFUSED", "Recipe", "built"]

_MODULES = (python_tools, containers, rumoca_pid, casadi_pid, variants)

RECIPES: dict[str, Recipe] = {recipe.name: recipe for module in _MODULES for recipe in module.RECIPES}
"""Controllers that the benchmark runs, by name."""

REFUSED: dict[str, Recipe] = {recipe.name: recipe for recipe in variants.REFUSED}
"""Controllers that it must refuse, by name."""
