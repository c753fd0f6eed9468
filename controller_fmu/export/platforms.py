"""Binaries for other platforms than this machine's, by the C compiler in the package ``ziglang``."""

from __future__ import annotations

import struct
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec

from controller_fmu.errors import NoCompilerError, PlatformError

REMEDY = "pip install 'flexible-manipulator-benchmark[native]'"
"""Installs the package ``ziglang``."""


@dataclass(frozen=True)
class Platform:
    """A platform that binaries can be built for."""

    target: str
    """The compiler's name for it; C libraries of Linux as old as this version will do."""
    folders: tuple[str, ...]
    """Where tools look for it in FMUs of FMI 1 and 2; in those of FMI 3 it is the platform's own name."""
    suffix: str


PLATFORMS: Mapping[str, Platform] = {
    "x86_64-linux": Platform("x86_64-linux-gnu.2.28", ("linux64",), ".so"),
    "aarch64-linux": Platform("aarch64-linux-gnu.2.28", ("aarch64-linux",), ".so"),
    "x86_64-windows": Platform("x86_64-windows-gnu", ("win64",), ".dll"),
    "x86_64-darwin": Platform("x86_64-macos", ("darwin64",), ".dylib"),
    "aarch64-darwin": Platform("aarch64-macos", ("darwin64", "aarch64-darwin"), ".dylib"),
}
"""By FMI 3's names, which FMI 2.0.4 refers to for what has no name of its own there. Tools that are older look for both
processors of macOS in ``darwin64``."""


def cross_compilers(platforms: Sequence[str]) -> dict[str, list[str]]:
    """Return the commands of the C compilers for ``platforms``, by their names in PLATFORMS.

    A folder of FMI 2 stands for the platforms whose binaries are in it: ``darwin64`` for both processors of macOS.
    Raises :class:`PlatformError` for another name and :class:`NoCompilerError` without the package ``ziglang``.
    """
    named = [own for platform in platforms for own in _named(platform)]
    if platforms and find_spec("ziglang") is None:
        what = "binaries for other platforms need the package ziglang"
        raise NoCompilerError(what, value="ziglang", remedy=REMEDY)
    # With a target given, the code is for any processor of the platform, not for this machine's own.
    command = [sys.executable, "-m", "ziglang", "cc", "-target"]
    return {platform: [*command, PLATFORMS[platform].target] for platform in named}


def _named(name: str) -> list[str]:
    found = [name] if name in PLATFORMS else [own for own, platform in PLATFORMS.items() if name in platform.folders]
    if not found:
        raise PlatformError(f"no platform is named {name!r}", value=name, nearest=tuple(PLATFORMS))
    return found


def binaries(libraries: Mapping[str, bytes], identifier: str, version: int) -> dict[str, bytes]:
    """Return the files below ``binaries`` for the library of each platform, as FMI ``version`` names them.

    Where two architectures have one folder, both go into one universal file.
    """
    folders: dict[str, list[bytes]] = {}
    for name, library in libraries.items():
        for folder in (name,) if version == 3 else PLATFORMS[name].folders:
            folders.setdefault(f"{folder}/{identifier}{PLATFORMS[name].suffix}", []).append(library)
    return {f"binaries/{path}": built[0] if len(built) == 1 else universal(built) for path, built in folders.items()}


_ALIGNMENT = 14
"""Binary logarithm of the largest page of macOS [bytes], at whose multiples the parts of a universal file begin."""


def universal(parts: list[bytes]) -> bytes:
    """Return the universal Mach-O file of 64-bit Mach-O files of several architectures."""
    page = 1 << _ALIGNMENT
    table = struct.pack(">II", 0xCAFEBABE, len(parts))
    body = b""
    for part in parts:
        body += bytes(-len(body) % page)
        architecture = struct.unpack_from("<II", part, 4)  # type and subtype of the processor
        table += struct.pack(">IIIII", *architecture, page + len(body), len(part), _ALIGNMENT)
        body += part
    return table.ljust(page, b"\0") + body
