"""The PID from exporters that turn Python classes into FMUs: pythonfmu3 (FMI 3.0) and component-model (FMI 2.0)."""

import subprocess
import sys
import tempfile
from functools import partial
from pathlib import Path

from .recipe import Recipe

SOURCES = Path(__file__).parent / "sources" / "python"
LAW = "two_axis_pid_law.py"

# Exporters import the slave and leave it imported: each runs in a process of its own.
_PYTHONFMU3 = "from pythonfmu3 import FmuBuilder; build = FmuBuilder.build_FMU"
_COMPONENT_MODEL = """
from component_model.model import Model
build = lambda script_file, dest, project_files: Model.build(script_file, project_files, dest)
"""


def _export(target: Path, exporter: str, script: str, arrays: bool = False) -> Path:
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        for name in (script, LAW):
            text = (SOURCES / name).read_text(encoding="utf-8")
            Path(folder, name).write_text(text.replace("ARRAYS = False", f"ARRAYS = {arrays}"), encoding="utf-8")
        program = f"{exporter}\nbuild(script_file={script!r}, dest={folder!r}, project_files=[{LAW!r}])"
        command = [sys.executable, "-B", "-c", program]
        subprocess.run(command, cwd=folder, check=True, capture_output=True, text=True)
        return next(Path(folder).glob("*.fmu")).replace(target)


_export3 = partial(_export, exporter=_PYTHONFMU3, script="pythonfmu3_pid.py")
_component_model = partial(_export, exporter=_COMPONENT_MODEL, script="component_model_pid.py")

RECIPES = (
    Recipe("pythonfmu3_scalars", _export3, needs=("pythonfmu3",)),
    Recipe("pythonfmu3_arrays", partial(_export3, arrays=True), needs=("pythonfmu3",)),
    Recipe("component_model", _component_model, needs=("component_model",)),
)
