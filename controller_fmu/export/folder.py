"""The FMU of a folder of sources, whatever language they are written in."""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

from controller_fmu.errors import DialectError, PlatformError, SourceError
from controller_fmu.export.c_fmu import c_fmu
from controller_fmu.export.dialects import Dialect
from controller_fmu.export.python_fmu import python_fmu

DATA = (".csv", ".json", ".mat", ".npy", ".npz", ".onnx", ".toml", ".txt")
"""Suffixes of the data files that travel with a slave in Python."""


def build_folder(
    folder: Path, target: Path | None = None, dialect: Dialect | None = None, platforms: Sequence[str] = ()
) -> Path:
    """Build the FMU of the controller in ``folder`` and return its path.

    Args:
        folder: either .c files and a ``modelDescription.xml`` (see :func:`c_fmu`), or a slave in Python: one
            ``*_fmu.py``, or one script that mentions ``Fmi2Slave``, with a dict ``UNITS`` (see :func:`python_fmu`).
            Its other modules, packages and data files travel with it.
        target: the FMU file to write; ``my_controller/MyController.fmu`` for the folder ``my_controller`` if None.
        dialect: which FMI to build for; FMI 2.0 co-simulation if None, which is all there is for Python.
        platforms: for C, names in PLATFORMS as for :func:`c_fmu`; an FMU in Python has the binaries of pythonfmu.

    Raises:
        SourceError: the folder holds neither, or more than one slave.
        PlatformError: there is no such platform, or the controller is in Python.
        BuildError: anything else that :func:`c_fmu` and :func:`python_fmu` raise.
    """
    target = target or folder / file_name(folder)
    description = folder / "modelDescription.xml"
    if description.is_file() and any(folder.glob("*.c")):
        return c_fmu(sorted(folder.glob("*.[ch]")), description, target, dialect, platforms)
    script = _slave(folder)
    if dialect not in (None, Dialect()):
        raise DialectError("a controller in Python becomes an FMU of FMI 2.0 co-simulation only", str(script))
    if platforms:
        what = "a controller in Python becomes an FMU with the binaries of pythonfmu, for no other platforms"
        raise PlatformError(what, str(script), value=",".join(platforms))
    others = sorted(path for path in folder.iterdir() if path != script and not path.name.startswith("."))
    companions = [path for path in others if path.suffix in (".py", *DATA) or (path / "__init__.py").is_file()]
    return python_fmu(script, companions, script.stem, target)


def file_name(folder: Path) -> str:
    """Return the name of the FMU of the controller in ``folder``: ``MyController.fmu`` for ``my_controller``."""
    return f"{model_name(folder.resolve().name)}.fmu"


def model_name(name: str) -> str:
    """Return ``name`` as the name of a model or class: ``MyController`` for ``my_controller``."""
    return "".join(part[:1].upper() + part[1:] for part in re.split(r"[^0-9A-Za-z]+", name))


def _slave(folder: Path) -> Path:
    scripts = sorted(folder.glob("*.py"))
    slaves = [script for script in scripts if script.stem.endswith("_fmu")] or [
        script for script in scripts if b"Fmi2Slave" in script.read_bytes()
    ]
    if len(slaves) > 1:
        names = tuple(slave.name for slave in slaves)
        raise SourceError("has more than one slave in Python", str(folder), nearest=names, remedy="keep one per folder")
    if not slaves:
        remedy = "a controller in C is .c files and a modelDescription.xml, one in Python a script *_fmu.py"
        raise SourceError("holds no controller", str(folder), remedy=remedy)
    return slaves[0]
