"""Compiling FMUs that come as source code."""

from __future__ import annotations

import functools
import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription

from controller_fmu.export import COMPILERS, FMI_HEADERS, BuildError, find_compiler, run_compiler

from ..cache import DEVICES, user_folders
from ..errors import InputError
from .library import FLAGS

SYSTEM_TO_READ = (
    *("--unshare-all", "--die-with-parent", "--ro-bind", "/", "/", "--proc", "/proc"),
    *("--tmpfs", "/dev", *(word for name in DEVICES for word in ("--dev-bind", name, name))),
)
"""Options of bubblewrap; the folders of users are hidden by others."""


def compile_sources(name: str, folder: Path, identifier: str, description: ModelDescription, library: Path) -> None:
    """Compile the sources that the description of the FMU ``name`` lists into ``library``.

    Raises :class:`InputError` if there is no compiler or the sources do not compile.
    """
    alternative = f"export the FMU with a binary for {fmpy.platform}"
    try:
        compiler = find_compiler()
    except BuildError as problem:
        message = f"{name} comes as source code only, and {problem}; or {alternative}."
        raise InputError(message, "no-compiler", name) from None
    if compiler is None:
        compilers = os.environ.get("CC") or ", ".join(COMPILERS)
        message = f"{name} comes as source code only, and there is no C compiler here ({compilers}). Install one, or"
        raise InputError(f"{message} {alternative}.", "no-compiler", name, compilers)
    sources, definitions = _listed(folder, identifier, description)
    if not sources:
        message = f"{name} has a folder of sources, but its description lists none to compile."
        raise InputError(message, "bad-sources", name)
    for source in sources:
        # The list is a stranger's: "../../x.c" would have the compiler
        # read, and quote in its errors, files of the user.
        if not (folder / "sources" / source).resolve().is_relative_to((folder / "sources").resolve()):
            message = f"{name} is refused: its source file {source!r} lies outside the FMU."
            raise InputError(message, "bad-sources", name, source)
    # Another process may compile the same FMU: the library appears by a rename, complete or not at all.
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        output = Path(scratch) / library.name
        command = [
            *compiler,
            *FLAGS,
            *definitions,
            *(f"-I{path}" for path in (folder / "sources", FMI_HEADERS)),
            *(str(folder / "sources" / source) for source in sources),
            *("-o", str(output), "-lm"),
        ]
        try:
            run_compiler([*_fence(scratch, compiler, "ziglang" in compiler), *command], output)
        except BuildError as problem:
            told = str(problem).replace(f"{folder}{os.sep}", "").splitlines()
            # Behind a page of warnings, the reason was cut off.
            lines = "\n  ".join(sorted(told, key=lambda line: "error:" not in line)[:5])
            message = f"The sources of {name} do not compile:\n  {lines}\n"
            message += f"Mend the sources or the compiler (the environment's CC), or {alternative}."
            raise InputError(message, "bad-sources", name) from None
        library.parent.mkdir(parents=True, exist_ok=True)
        os.replace(output, library)


@functools.cache
def _has_fence() -> bool:
    """Whether bubblewrap is there and works."""
    tried = ["bwrap", *SYSTEM_TO_READ, "true"]
    return shutil.which("bwrap") is not None and subprocess.run(tried, capture_output=True, check=False).returncode == 0


def _fence(folder: str, compiler: Sequence[str], zig: bool) -> list[str]:
    """The words before a ``compiler`` that let it write into ``folder`` only, read beside that what the system, Python
    and the FMU around the folder hold, and reach no network, if bubblewrap is there.

    Sources of a stranger tell the compiler what to read, and may use its defects. What they include they could hand to
    a controller that must not know it, such as the certificate that is repeated.
    """
    if not _has_fence():
        return []
    program = shutil.which(compiler[0]) or sys.executable
    # The program may be a link (/usr/bin/cc), and needs what lies beside its target.
    around = [str(parent) for name in (program, os.path.realpath(program)) for parent in Path(name).parents[:2]]
    shown = [sys.prefix, sys.base_prefix, str(FMI_HEADERS), os.path.dirname(folder), *around]
    hidden = user_folders()
    below = sorted({name for name in shown if any(Path(name).is_relative_to(home) for home in hidden)} - hidden)
    read = [word for name in sorted(hidden) for word in ("--tmpfs", name)]
    read += [word for name in below for word in ("--ro-bind", name, name)]
    places = [folder]
    if zig:  # of the extra native: without its cache each run takes ten seconds
        places.append(os.environ.get("ZIG_GLOBAL_CACHE_DIR") or os.path.expanduser("~/.cache/zig"))
        os.makedirs(places[-1], exist_ok=True)
    bound = (word for place in places for word in ("--bind", place, place))
    return ["bwrap", *SYSTEM_TO_READ, *read, *bound, "--setenv", "TMPDIR", folder, "--"]


def _listed(folder: Path, identifier: str, description: ModelDescription) -> tuple[list[str], list[str]]:
    """Source files below ``sources`` and preprocessor definitions as compiler options."""
    for configuration in description.buildConfigurations:
        # A file for both kinds may have a build configuration for each; the
        # other one's sources define the same functions twice.
        if configuration.modelIdentifier in (None, identifier):
            sets = configuration.sourceFileSets
            definitions = [f"-D{d.name}={d.value or ''}" for files in sets for d in files.preprocessorDefinitions]
            return [source for files in sets for source in files.sourceFiles], definitions
    return sorted(path.name for path in (folder / "sources").glob("*.c")), []
