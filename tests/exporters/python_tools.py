"""The PID from exporters that turn Python classes into FMUs: pythonfmu3 (FMI 3.0) and component-model (FMI 2.0)."""

from __future__ import annotations

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from .recipe import ARRAYS, Ports, Recipe

SOURCES = Path(__file__).parent / "sources" / "python"
LAW = "two_axis_pid_law.py"

# Exporters import the slave and leave it imported: each runs in a process of its own.
_PYTHONFMU3 = "from pythonfmu3 import FmuBuilder; build = lambda **files: FmuBuilder.build_FMU(**files)"
_COMPONENT_MODEL = """
from component_model.model import Model
build = lambda script_file, dest, project_files: Model.build(script_file, project_files, dest)
"""


def _export(target: Path, exporter: str, script: str) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        program = f"{exporter}\nbuild(script_file={script!r}, dest={folder!r}, project_files=[{LAW!r}])"
        command = [sys.executable, "-B", "-c", program]
        subprocess.run(command, cwd=SOURCES, check=True, capture_output=True, text=True)
        return next(Path(folder).glob("*.fmu")).replace(target)


RECIPES = (
    Recipe(
        "pythonfmu3_scalars",
        partial(_export, exporter=_PYTHONFMU3, script="pythonfmu3_scalars.py"),
        modules=("pythonfmu3",),
    ),
    Recipe(
        "pythonfmu3_arrays",
        partial(_export, exporter=_PYTHONFMU3, script="pythonfmu3_arrays.py"),
        modules=("pythonfmu3",),
        ports=ARRAYS,
    ),
    Recipe(
        "component_model",
        partial(_export, exporter=_COMPONENT_MODEL, script="component_model_pid.py"),
        modules=("component_model",),
        ports=Ports(*((f"{name}[0]", f"{name}[1]") for name in ("q_m_ref", "q_m", "u_m", "u_m0"))),
    ),
)
