"""Compiling FMUs that come as source code."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription

from controller_fmu.export import COMPILERS, FMI_HEADERS, BuildError, find_compiler, run_compiler

from ..cache import DEVICES, PRIVATE, user_folders
from ..errors import EnvironmentFault, InputError
from .entries import COMPILED, file_digest
from .library import FLAGS, digest_file

SYSTEM_TO_READ = (
    *("--unshare-all", "--die-with-parent", "--ro-bind", "/", "/", "--proc", "/proc"),
    *("--tmpfs", "/dev", *(word for name in DEVICES for word in ("--dev-bind", name, name))),
)
"""Options of bubblewrap; the folders of users are hidden by others."""

SCRATCH_BYTES = 256 * 1024**2
"""Bytes that a fenced compiler may write, of all its files together."""

HANDED_OUT = '"$@" && { [ ! -e "$0" ] || cat "$0" > "$0.out"; }'
"""Words of a shell that runs the compiler and hands its library out of the fence, by the contents: linkers replace the
file that they write."""

OUTSIDE = re.compile(r"^(?!.*(?::\d+:|\|))(?:cat: |.*\bKilled\b|.*\bended by signal 9\b)", re.MULTILINE)
"""In what is told of a compiler that sources have no part in, as they have in lines with a number or a bar: the disk is
full for the library that is handed out, or somebody has ended it, as where memory is short. Its controller was refused
for that."""

FULL = re.compile(r"No space left on device|Disk quota exceeded")
"""The same without a fence, in which a compiler fills nothing but its own bounded memory."""

COMPILERS_OWN = (
    *("PATH", "HOME", "LANG", "LANGUAGE", "TMPDIR", "XDG_CACHE_HOME", "LD_LIBRARY_PATH", "PYTHONPATH"),
    *("SDKROOT", "CPATH", "LIBRARY_PATH"),
    *("SYSTEMROOT", "LOCALAPPDATA", "TEMP", "TMP", "INCLUDE", "LIB"),  # Windows
)
COMPILERS_OWN_BEGINNINGS = ("LC_", "C_INCLUDE_", "GCC_", "COMPILER_", "NIX_", "CONDA_BUILD_", "CCACHE_", "ZIG_")
"""Of the environment: what a compiler may need. A source that includes /proc/self/environ hands on all of it."""


def compile_sources(name: str, folder: Path, identifier: str, description: ModelDescription, library: Path) -> None:
    """Compile the sources that the description of the FMU ``name`` lists into ``library``.

    Raises :class:`InputError` if there is no compiler or the sources do not compile, and as :func:`_has_fence`;
    :class:`EnvironmentFault` if it is this machine that keeps them from that.
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
    with tempfile.TemporaryDirectory(prefix=f"{COMPILED}-", dir=folder) as scratch:
        output = Path(scratch) / library.name
        command = [
            *compiler,
            *FLAGS,
            *definitions,
            *(f"-I{path}" for path in (folder / "sources", FMI_HEADERS)),
            *(str(folder / "sources" / source) for source in sources),
            *("-o", str(output), "-lm"),
        ]
        fence = _fence(output, compiler, "ziglang" in compiler)
        try:
            run_compiler([*fence, *command], output, environment=_environment(os.environ))
        except BuildError as problem:
            if fence and str(problem).startswith("bwrap"):  # its own words: it is gone since it was tried
                raise InputError(f"The sources of {name} cannot be compiled now: {problem}", "no-sandbox") from None
            if fence:
                _has_fence()  # else it may be the fence that has failed
            if OUTSIDE.search(str(problem)) or not fence and FULL.search(str(problem)):
                message = f"The sources of {name} cannot be compiled now: {problem}"
                raise EnvironmentFault(message, "not-compiled") from problem
            told = str(problem).replace(f"{folder}{os.sep}", "").splitlines()
            # Behind a page of warnings, the reason was cut off.
            lines = "\n  ".join(sorted(told, key=lambda line: "error:" not in line)[:5])
            message = f"The sources of {name} do not compile:\n  {lines}\n"
            message += f"Mend the sources or the compiler (the environment's CC), or {alternative}."
            raise InputError(message, "bad-sources", name) from None
        library.parent.mkdir(parents=True, exist_ok=True)
        noted = Path(scratch) / "noted"
        noted.write_text(file_digest(output))
        os.replace(noted, digest_file(library))
        os.replace(output, library)


def _has_fence() -> bool:
    """Whether bubblewrap is there and works.

    Raises :class:`InputError` if it does not beside a private folder. While it was gone for seconds, as in an upgrade,
    sources with ``.incbin`` got the database of a service into their library.
    """
    try:
        works = subprocess.run(["bwrap", *SYSTEM_TO_READ, "true"], capture_output=True, check=False).returncode == 0
    except OSError:
        works = False
    if not works and os.environ.get(PRIVATE):
        message = "Sources are compiled here in a sandbox alone, and bubblewrap (bwrap) is not there, or does not work."
        raise InputError(message, "no-sandbox")
    return works


def _environment(outside: Mapping[str, str]) -> dict[str, str]:
    """What of the environment ``outside`` a compiler of a stranger's sources has."""
    return {k: v for k, v in outside.items() if k in COMPILERS_OWN or k.startswith(COMPILERS_OWN_BEGINNINGS)}


def _fence(output: Path, compiler: Sequence[str], zig: bool) -> list[str]:
    """The words before a ``compiler`` that let it write one file on the disk, ``output``, and beside it a bounded
    amount into memory; read what the system, Python and the FMU around the file's folder hold; and reach no network, if
    bubblewrap is there.

    Sources of a stranger tell the compiler what to read, and may use its defects. What they include they could hand to
    a controller that must not know it, such as the certificate that is repeated. Of a private folder they see the FMU.

    Raises as :func:`_has_fence`.
    """
    if not _has_fence():
        return []
    program = shutil.which(compiler[0]) or sys.executable
    # The program may be a link (/usr/bin/cc), and needs what lies beside its target.
    around = [str(parent) for name in (program, os.path.realpath(program)) for parent in Path(name).parents[:2]]
    scratch = str(output.parent)
    shown = [sys.prefix, sys.base_prefix, str(FMI_HEADERS), os.path.dirname(scratch), *around]
    hidden = user_folders() | _private(shown)
    below = {name for name in shown if any(Path(name).is_relative_to(home) for home in hidden)} - hidden
    mounts = {name: ("--tmpfs", name) for name in hidden} | {name: ("--ro-bind", name, name) for name in below}
    # A folder before what lies in it. That of a service lay beside a compiler's (<X>/s and <X>/bin/cc), and was shown.
    read = [word for name in sorted(mounts) for word in mounts[name]]
    # Sources of 34 kB, of which each becomes an object of 0.9 GB, filled the disk with 7 GB.
    write = ["--size", str(SCRATCH_BYTES), "--tmpfs", scratch, "--setenv", "TMPDIR", scratch]
    output.touch()
    write += ["--bind", str(output), f"{output}.out"]
    if zig:  # of the extra native: without its cache each run takes ten seconds
        cache = os.environ.get("ZIG_GLOBAL_CACHE_DIR") or os.path.expanduser("~/.cache/zig")
        os.makedirs(cache, exist_ok=True)
        write += ["--bind", cache, cache]
    return ["bwrap", *SYSTEM_TO_READ, *read, *write, "--", "sh", "-c", HANDED_OUT, str(output)]


def _private(shown: Iterable[str]) -> set[str]:
    """The private folder, by its own path and by that from each of the ``shown`` folders: one may be a link."""
    if not os.path.isdir(private := os.environ.get(PRIVATE, "")):
        return set()
    own = Path(private).resolve()
    around = [(name, real) for name in shown if own.is_relative_to(real := os.path.realpath(name))]
    return {str(own), *(str(Path(name, own.relative_to(real))) for name, real in around)}


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
