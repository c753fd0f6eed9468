"""Hostile controllers for Windows, and what is left of Wine after them."""

import os
import subprocess
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory

from support.tools import MINGW, require

from controller_fmu.export.archive import pack
from controller_fmu.export.c_fmu import FMI_HEADERS
from orchestrator.cache import cache_folder

from .fmus import NAME, SOURCES, edited

LIBRARY = f"binaries/win64/{NAME}.dll"


@cache
def library() -> bytes:
    """The DLL of ``windows.c``; the test is skipped where there is no compiler for Windows."""
    require("mingw")
    with TemporaryDirectory() as folder:
        target = Path(folder, "library.dll")
        options = ["-std=gnu99", "-O1", "-shared", "-s", "-w", f"-I{FMI_HEADERS}", "-o", str(target)]
        subprocess.run([MINGW, *options, str(SOURCES / "windows.c")], check=True)
        return target.read_bytes()


def windows_fmu(folder: Path, fault: str = "none", content: bytes | None = None) -> Path:
    """The FMU with ``fault`` in ``folder``, or with another DLL."""
    file = folder / f"Windows-{fault}.fmu"
    own = library() if content is None else content
    file.write_bytes(pack({"modelDescription.xml": edited(), LIBRARY: own, "resources/fault.txt": fault.encode()}))
    return file


def left_of_wine() -> list[str]:
    """The command lines of processes in installations of Wine that this cache has."""
    beginning = f"WINEPREFIX={cache_folder() / 'wine'}/".encode()
    found = []
    for place in Path("/proc").glob("[0-9]*"):
        try:
            variables, words = (place / "environ").read_bytes(), (place / "cmdline").read_bytes()
        except OSError:  # it has ended, or is somebody else's
            continue
        if os.getpid() != int(place.name) and words and any(v.startswith(beginning) for v in variables.split(b"\0")):
            found.append(words.replace(b"\0", b" ").decode())
    return found
