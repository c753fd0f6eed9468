"""What every exporter's recipe says of itself: how to build its FMU, what that needs, and what to expect of it."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from support.tools import require

from orchestrator.loop.behaviour import Convention


@dataclass(frozen=True)
class Recipe:
    """One way to make the benchmark's two-axis PID, eq. (12)-(13), with default gains."""

    name: str
    """Also the stem of the FMU's file."""
    make: Callable[[Path], Path]
    """Writes the FMU to a path and returns it."""
    needs: tuple[str, ...] = ()
    """The tools of ``support.tools`` that this takes."""
    convention: Convention = Convention.STEP_START
    tolerance: float = 0.0
    """How far torques may be from the law's, relative to the greatest of them; 0 where the arithmetic is the same."""


def built(recipe: Recipe, folder: Path) -> Path:
    """``folder/name.fmu``, made unless it is there; the test is skipped where the exporter or a compiler is missing."""
    require(*recipe.needs)
    path = folder / f"{recipe.name}.fmu"
    return path if path.exists() else recipe.make(path)
