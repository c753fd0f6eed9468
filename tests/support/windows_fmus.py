"""FMUs that have a library for Windows only, and a Wine of Linux that loads shared objects in its place."""

from __future__ import annotations

import os
import subprocess
import tempfile
import zipfile
from functools import cache
from pathlib import Path

from controller_fmu.export import C_INTERFACE, FMI_HEADERS
from controller_fmu.export.archive import pack
from controller_fmu.export.compiler import require_compiler
from orchestrator.fmi.host import build

from .tools import MINGW, require

PLACES = {"win64": "linux64", "x86_64-windows": "x86_64-linux"}


def pretending(fmu: Path, folder: Path) -> Path:
    """The FMU with its library for Linux in the place of one for Windows, without sources."""
    return _packed(fmu, folder, lambda library, _: library)


def for_windows(fmu: Path, folder: Path) -> Path:
    """The FMU with a library for Windows alone, compiled of its sources by MinGW; skips the test without that."""
    require("mingw")
    return _packed(fmu, folder, lambda _, sources: _compiled(sources))


def _packed(fmu, folder, library_of):
    with zipfile.ZipFile(fmu) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    (native,) = (name for name in files if name.endswith(".so"))
    platform = next(windows for windows, linux in PLACES.items() if f"/{linux}/" in native)
    sources = {name: content for name, content in files.items() if name.startswith("sources/")}
    kept = {name: files[name] for name in files if name not in sources and name != native}
    kept[f"binaries/{platform}/{Path(native).stem}.dll"] = library_of(files[native], sources)
    folder.mkdir(parents=True, exist_ok=True)
    (folder / fmu.name).write_bytes(pack(kept))
    return folder / fmu.name


def _compiled(sources: dict[str, bytes]) -> bytes:
    with tempfile.TemporaryDirectory() as place:
        for name, content in sources.items():
            (Path(place) / Path(name).name).write_bytes(content)
        target = Path(place, "library.dll")
        options = ["-std=gnu99", "-O2", "-ffp-contract=off", "-shared", "-s", f"-I{FMI_HEADERS}", f"-I{C_INTERFACE}"]
        files = sorted(map(str, Path(place).glob("*.c")))
        subprocess.run([MINGW, *options, "-o", str(target), *files], check=True)
        return target.read_bytes()


@cache
def _twin() -> bytes:
    require("compiler", "x86_64-linux")
    with tempfile.TemporaryDirectory() as place:
        target = Path(place, "host")
        build.build(target, require_compiler(), ["-ldl"])
        return target.read_bytes()


def twin_of_wine(folder: Path) -> str:
    """A PATH with a program that says it is Wine and starts the host that is compiled for this system."""
    host, wine = folder / "host", folder / "wine"
    folder.mkdir(exist_ok=True)
    host.write_bytes(_twin())
    wine.write_text(f'#!/bin/sh\n[ "$1" = --version ] && echo wine-0.0 && exit\nexec "{host}"\n')
    for program in (host, wine):
        program.chmod(0o755)
    return os.pathsep.join((str(folder), *filter(None, os.environ["PATH"].split(os.pathsep))))
