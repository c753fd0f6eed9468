"""FMUs from Python slaves, built by pythonfmu and completed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from controller_fmu.export.archive import BuildError, content_guid, pack, unpack, write_atomically
from controller_fmu.export.description import complete, parse, to_bytes

# pythonfmu leaves the slave's modules and an altered sys.path behind: it gets a process of its own. That also
# reads UNITS, so that no code of a slave ever runs here.
_EXPORT = """
import importlib, json, os, sys
from pythonfmu.builder import FmuBuilder
script, units_module, *packages = sys.argv[1:]
sys.path[:0] = {os.path.dirname(package) for package in packages}
FmuBuilder.build_FMU(script, "draft.fmu", packages)
with open("units.json", "w") as file:
    json.dump(importlib.import_module(units_module).UNITS, file)
"""


def python_fmu(script: Path, packages: Sequence[Path], units_module: str, target: Path) -> Path:
    """Build the FMU of a pythonfmu slave and return ``target``.

    Args:
        script: the module with the slave's class.
        packages: package folders, modules and data files that the script needs, wherever they lie; they travel in
            the FMU's resources, beside the script.
        units_module: the module, as the script would import it, with a dict ``UNITS`` from variable names
            without index to units, ``{"q_m": "rad"}``; "1" for a variable without dimension.
        target: the FMU file to write; it is replaced in one go.

    Raises:
        BuildError: pythonfmu is missing or failed, or a variable has no unit.
    """
    for source in (script, *packages):
        if not source.exists():
            raise BuildError(f"{target.name}: {source} does not exist")
    contents, units = _export(script, packages, units_module)
    root = complete(parse(contents.pop("modelDescription.xml")), units)
    root.set("guid", "")
    root.set("guid", content_guid({**contents, "modelDescription.xml": to_bytes(root)}))
    return write_atomically(pack({**contents, "modelDescription.xml": to_bytes(root)}), target)


def _export(script: Path, packages: Sequence[Path], units_module: str) -> tuple[dict[str, bytes], dict[str, str]]:
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        finished = subprocess.run(
            [
                sys.executable,
                "-c",
                _EXPORT,
                str(script.resolve()),
                units_module,
                *(str(p.resolve()) for p in packages),
            ],
            cwd=folder,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        if finished.returncode != 0:
            raise BuildError(
                f"pythonfmu could not build {script}; is it installed (pip install pythonfmu), does the "
                f"slave import, and has {units_module} a dict UNITS?\n{finished.stderr.strip()}"
            )
        return unpack(Path(folder, "draft.fmu")), json.loads(Path(folder, "units.json").read_text())
