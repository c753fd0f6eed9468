"""FMUs from Python slaves, built by pythonfmu and completed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Iterator, Sequence
from pathlib import Path

from controller_fmu.errors import SourceError, located
from controller_fmu.export.archive import check_target, content_guid, pack, unpack, write_atomically
from controller_fmu.export.description import BaseUnit, complete, parse, to_bytes

# pythonfmu leaves the slave's modules and an altered sys.path behind: it gets a process of its own. That also
# reads the units, so that no code of a slave ever runs here.
_EXPORT = """
import importlib, json, os, sys
from pythonfmu.builder import FmuBuilder
script, units_module, *packages = sys.argv[1:]
sys.path[:0] = {os.path.dirname(package) for package in packages}
FmuBuilder.build_FMU(script, "draft.fmu", packages)
with open("units.json", "w") as file:
    module = importlib.import_module(units_module)
    json.dump([getattr(module, name, {}) for name in ("UNITS", "BASE_UNITS", "ENUMERATIONS")], file)
"""


def python_fmu(script: Path, packages: Sequence[Path], units_module: str, target: Path) -> Path:
    """Build the FMU of a pythonfmu slave and return ``target``.

    Args:
        script: the module with the slave's class.
        packages: package folders, modules and data files that the script needs, wherever they lie; they travel in
            the FMU's resources, beside the script.
        units_module: the module, as the script would import it, with a dict ``UNITS`` from variable names without
            index to units, ``{"q_m": "rad"}``, "1" for a variable without dimension; for units that are not known here,
            a dict ``BASE_UNITS``, ``{"deg": {"rad": 1, "factor": 0.0174532925199433}}``; and for integer variables that
            are enumerations, a dict ``ENUMERATIONS`` of their items, which count from 1, ``{"mode": ("off", "on")}``.
        target: the FMU file to write, in a folder that exists; it is replaced in one go.

    Raises:
        TargetError: there is no folder for ``target``.
        SourceError: a source is missing or has a syntax error, or pythonfmu fails with it.
        UnitError: a variable has no unit, or one that is neither known nor defined.
        DescriptionError: an enumeration is no integer variable.
    """
    check_target(target)
    for source in (script, *packages):
        if not source.exists():
            raise SourceError("the file does not exist", str(source), value=source.name)
    for file in _modules((script, *packages)):
        _check_syntax(file)
    contents, declared = _export(script, packages, units_module)
    with located(script):
        root = complete(parse(contents.pop("modelDescription.xml")), *declared)
    root.set("guid", "")
    root.set("guid", content_guid({**contents, "modelDescription.xml": to_bytes(root)}))
    return write_atomically(pack({**contents, "modelDescription.xml": to_bytes(root)}), target)


def _modules(sources: Sequence[Path]) -> Iterator[Path]:
    for source in sources:
        if source.is_dir():
            yield from sorted(source.rglob("*.py"))
        elif source.suffix == ".py":
            yield source


def _check_syntax(file: Path) -> None:
    """Compile ``file`` without running it."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            compile(file.read_bytes(), str(file), "exec", dont_inherit=True)
    except SyntaxError as problem:
        where = f"{file}:{problem.lineno}" if problem.lineno else str(file)
        raise SourceError(f"{type(problem).__name__}: {problem.msg}", where, value=file.name) from None
    except (ValueError, RecursionError, MemoryError) as problem:  # a null byte, nested too deeply
        what = f"cannot be compiled: {problem or type(problem).__name__}"
        raise SourceError(what, str(file), value=file.name) from None


Declared = tuple[dict[str, str], dict[str, BaseUnit], dict[str, list[str]]]
"""The dicts UNITS, BASE_UNITS and ENUMERATIONS of a slave's module."""


def _export(script: Path, packages: Sequence[Path], units_module: str) -> tuple[dict[str, bytes], Declared]:
    sources = [str(path.resolve()) for path in packages]
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        finished = subprocess.run(
            [sys.executable, "-c", _EXPORT, str(script.resolve()), units_module, *sources],
            cwd=folder,
            env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1"},
            capture_output=True,
            text=True,
            check=False,
        )
        if finished.returncode != 0:
            raise SourceError(f"pythonfmu cannot build the slave\n{finished.stderr.strip()}", str(script))
        units, base_units, enumerations = json.loads(Path(folder, "units.json").read_text())
        return unpack(Path(folder, "draft.fmu")), (units, base_units, enumerations)
