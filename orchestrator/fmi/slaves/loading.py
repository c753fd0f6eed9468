"""Why the platform's loader refuses the library of an FMU, from what it says."""

from __future__ import annotations

import platform
import re
import sys
from pathlib import Path

from ...errors import BenchmarkError, FmuError, InputError
from ..archive import Archive
from ..choice import NATIVE, has_sources

NEWER = re.compile(r"version [`'](GLIBC(?:XX)?_[\w.]+|CXXABI_[\w.]+)' not found")
MISSING = re.compile(r"([^\s:/]+): cannot open shared object file")


def refusal(archive: Archive, problem: Exception) -> BenchmarkError:
    """The error for a library that cannot be loaded. An :class:`InputError` says what to do about a binary that was
    built for a newer system than this one, or one that needs a library beside it and does not look for it there."""
    message, newer = f"{archive.name} cannot be loaded: {problem}", NEWER.search(str(problem))
    if (machine := _machine(archive.library)) not in (None, _machine(Path(sys.executable))):
        message = (
            f"{archive.name} cannot be loaded: its library {archive.library.name} is for another kind of processor "
        )
        message += f"(ELF machine {machine}). Export it for this one, {platform.machine()}."
        return InputError(message, "load", archive.name, archive.library.name)
    if newer is not None:
        message = f"{archive.name} cannot be loaded: its binary needs {newer[1]}, which is newer than this system. "
        if archive.way == NATIVE and has_sources(archive.folder):
            return InputError(f"{message}Its sources are in it.", "newer-system", archive.name, newer[1])
        return InputError(
            f"{message}Export it on an older system, or with its sources.", "load", archive.name, newer[1]
        )
    if (missing := MISSING.search(str(problem))) is not None:
        places = [path for path in archive.folder.rglob(missing[1]) if path.is_file()]
        if places:
            message = f"{archive.name} cannot be loaded: it needs {missing[1]}, which the FMU has in "
            message += (
                f"{places[0].parent.relative_to(archive.folder)}, but its library does not name the place. Link it "
            )
            message += "with the RPATH $ORIGIN (-Wl,-rpath,'$ORIGIN'), and put the other library beside it."
            return InputError(message, "load", archive.name, missing[1])
    return FmuError(message, "load")


def _machine(file: Path) -> int | None:
    """The processor that an ELF file is for, by its number there; None for a file of another kind."""
    try:
        with file.open("rb") as opened:
            head = opened.read(20)
    except OSError:
        return None
    return int.from_bytes(head[18:20], "little") if head[:4] == b"\x7fELF" and len(head) == 20 else None
