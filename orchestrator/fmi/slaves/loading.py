"""Why the platform's loader refuses the library of an FMU, from what it says."""

from __future__ import annotations

import re

from ...errors import BenchmarkError, FmuError, InputError
from ..archive import Archive
from ..choice import NATIVE, has_sources

NEWER = re.compile(r"version [`'](GLIBC(?:XX)?_[\w.]+|CXXABI_[\w.]+)' not found")
MISSING = re.compile(r"([^\s:/]+): cannot open shared object file")


def refusal(archive: Archive, problem: Exception) -> BenchmarkError:
    """The error for a library that cannot be loaded. An :class:`InputError` says what to do about a binary that was
    built for a newer system than this one, or one that needs a library beside it and does not look for it there."""
    message, newer = f"{archive.name} cannot be loaded: {problem}", NEWER.search(str(problem))
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
