"""Which library of an FMU is loaded: its binary for this platform, one compiled of its sources, or that for Windows."""

from __future__ import annotations

from pathlib import Path
from typing import Final, Literal

from ..errors import InputError
from .host import wine

NATIVE: Final = "native"
SOURCE: Final = "source"
WINE: Final = "wine"
LIBRARIES = (NATIVE, SOURCE, WINE)

# A fused multiply-add rounds once where the source rounds twice: the
# same FMU would give other bits on machines that have one.
FLAGS = ("-O2", "-ffp-contract=off", "-fPIC", "-shared")
"""Of the compiler, for the sources of an FMU."""

LibraryKind = Literal["native", "source", "wine"]
"""Where the library comes from: the FMU's binary for this platform, its sources, its binary for Windows under Wine."""


def digest_file(compiled: Path) -> Path:
    """Where the SHA-256 of a library stands that was compiled here."""
    return compiled.with_name(f"{compiled.name}.sha256")


def choose(name: str, folder: Path, windows: bool, tool: str, library: LibraryKind | None) -> LibraryKind:
    """Where the library of the FMU ``name`` in ``folder`` comes from, which has no binary for this platform or of which
    another ``library`` is asked for: its sources if there is a compiler, else that for Windows if it has one,
    ``windows``. ``tool`` is what the FMU needs at run time, if anything.

    Raises :class:`InputError` for an FMU without it, or whose library for Windows cannot be used here.
    """
    sources = has_sources(folder)
    # Sources go before Wine: compiled code runs in this process, while a host costs a change of process in each sample.
    if library == WINE or (library is None and windows and not (sources and _has_compiler())):
        _check_windows(name, windows, tool)
        return WINE
    if library == NATIVE or (library == SOURCE and not sources):
        what = "binary for this platform" if library == NATIVE else "sources that could be compiled"
        raise InputError(f"{name} has no {what}. Take another of its libraries.", "no-binary", name, library)
    if sources:
        return SOURCE
    # A 64-bit Wine does not load 32-bit libraries, and its own message (error 193) names no remedy.
    if {path.parent.name for path in (folder / "binaries").glob("*/*")} == {"win32"}:
        message = f"{name} has a library for Windows of 32 bits only (win32), which does not run here. Export it for"
        raise InputError(f"{message} Linux, or for Windows of 64 bits (win64).", "no-binary", name, "win32")
    return NATIVE


def has_sources(folder: Path) -> bool:
    """Whether the extracted FMU has sources in C. A folder without any does not count."""
    return any((folder / "sources").rglob("*.[ch]*"))


def _check_windows(name: str, windows: bool, tool: str) -> None:
    if not windows:
        message = f"{name} has no library for Windows of 64 bits. Take another of its libraries."
        raise InputError(message, "no-binary", name, WINE)
    # The tool is a program of the exporter's machine. The empty
    # installation of Wine has none, and the FMU would wait for it.
    if tool:
        message = f"{name} needs {tool} while it runs, which is not there under Wine. Export it to run alone."
        raise InputError(message, "execution-tool", name, tool)
    wine.needed(name)


def _has_compiler() -> bool:
    from controller_fmu.export import BuildError, find_compiler  # loads the builders, which only few FMUs need

    try:
        return find_compiler() is not None
    except BuildError:
        return False
