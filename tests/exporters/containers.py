"""The PID as a container FMU around two single-axis FMUs: fmu-manipulation-toolbox (FMI 2.0, 3.0) and FMPy (2.0)."""

import contextlib
import io
import tempfile
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Literal

from support.pid_fmus import T_S

from .native import CModel
from .recipe import Recipe

AXES = (1, 2)


@contextlib.contextmanager
def _axes(beside: Path) -> Iterator[Path]:
    """Give a folder, next to ``beside``, with the single-axis FMUs ``axis_1.fmu`` and ``axis_2.fmu``."""
    beside.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=beside.parent) as folder:
        for axis in AXES:
            CModel(axes=(axis - 1,)).build(Path(folder, f"axis_{axis}.fmu"))
        yield Path(folder)


def _fmu_manipulation_toolbox(target: Path, fmi_version: Literal[2, 3]) -> Path:
    from fmu_manipulation_toolbox.container import FMUContainer

    # It says on the console that it embeds FMI 2.0 into FMI 3.0.
    with _axes(target) as folder, contextlib.redirect_stdout(io.StringIO()):
        container = FMUContainer(target.stem, folder, fmi_version=fmi_version)
        for axis in AXES:
            part = f"axis_{axis}.fmu"
            container.get_fmu(part)
            for name in ("q_m_ref", "q_m", "u_m0"):
                container.add_input(f"{name}[{axis}]", part, name)
            container.add_output(part, "u_m", f"u_m[{axis}]")
        container.make_fmu(target.name, step_size=T_S)
        return (folder / target.name).replace(target)


_toolbox = {"needs": ("fmu_manipulation_toolbox", "compiler")}

RECIPES = (
    Recipe("container_fmi2", partial(_fmu_manipulation_toolbox, fmi_version=2), **_toolbox),
    Recipe("container_fmi3", partial(_fmu_manipulation_toolbox, fmi_version=3), **_toolbox),
)
