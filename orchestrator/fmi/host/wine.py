"""Wine on this machine: where it is, its version, and an installation of its own for each process that runs under it.

An installation ("prefix") is usually some hundred megabytes that ``wineboot`` makes in ten seconds, with services that
stay. An FMU needs none of that: here it is two links and an empty folder, Wine's libraries are found in Wine's own
folders, and there is no process beside the FMU's but Wine's server, which ends with it. Every process has its own, so
that none can disturb another, and nothing has to be locked, kept or mended.
"""

from __future__ import annotations

import functools
import os
import platform
import shutil
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

from ...cache import cache_folder
from ...errors import InputError

PROGRAMS = ("wine64", "wine")

INSTALL = "Install Wine (on Debian and Ubuntu: apt-get install wine64 wine)"

SETTINGS = {
    "WINEDEBUG": "-all",
    # No Mono and no Gecko, for which Wine would ask on a screen; and nothing that prepares a whole Windows.
    "WINEDLLOVERRIDES": "mscoree,mshtml=;wineboot.exe=d",
    "WINEBOOTSTRAPMODE": "1",  # libraries are found without their stand-ins in the installation
    "WINEARCH": "win64",
    "LC_ALL": "C.UTF-8",  # file names
}
"""Of the environment of programs under Wine."""

SHUTDOWN_TIMEOUT = 5.0
"""Seconds that Wine's server may take to end."""


@functools.cache
def _program(path: str) -> str | None:
    return next(filter(None, (shutil.which(name, path=path) for name in PROGRAMS)), None)


def program() -> str | None:
    """Wine's loader of programs of 64 bits, None if it is not installed."""
    # The path is part of the question, so that a test that changes it gets another answer in spite of the cache.
    return _program(os.environ.get("PATH", os.defpath)) if platform.machine() == "x86_64" else None


def version() -> str:
    """Such as ``"8.0"``; empty if it is not installed, or does not say."""
    loader = program()
    return _version(loader) if loader is not None else ""


@functools.cache
def _version(loader: str) -> str:
    with suppress(OSError, subprocess.TimeoutExpired):
        options = {"capture_output": True, "text": True, "stdin": subprocess.DEVNULL, "check": False, "timeout": 60}
        said = subprocess.run([loader, "--version"], env={**os.environ, **SETTINGS}, **options).stdout.split()  # type: ignore[call-overload]
        return said[0].removeprefix("wine-") if said else ""
    return ""


def needed(name: str) -> str:
    """The program for the FMU ``name``; raises :class:`InputError` where there is none."""
    loader = program()
    if loader is None:
        message = f"{name} has a library for Windows only, which runs under Wine, and Wine is not installed here. "
        message += f"{INSTALL}, or export the FMU for Linux."
        raise InputError(message, "no-wine", name)
    return loader


class Installation:
    """An installation in the cache, for programs that this process starts. Those of processes that are gone, of whose
    end nobody told, are removed."""

    def __init__(self) -> None:
        around = cache_folder() / "wine"
        around.mkdir(exist_ok=True)
        _remove_lost(around)
        self._folder = Path(tempfile.mkdtemp(prefix=f"{platform.node()}-{os.getpid()}-", dir=around))
        (self._folder / "drive_c" / "windows" / "system32").mkdir(parents=True)
        (self._folder / "dosdevices").mkdir()
        for drive, target in (("c:", "../drive_c"), ("z:", "/")):
            (self._folder / "dosdevices" / drive).symlink_to(target)

    def environment(self) -> dict[str, str]:
        """Of a program that runs in it."""
        # Without a screen, Wine shows no dialog that nobody would answer.
        kept = {name: value for name, value in os.environ.items() if name not in ("DISPLAY", "WAYLAND_DISPLAY")}
        # TMPDIR is where Debian's Wine has the socket of its server.
        return {**kept, **SETTINGS, "WINEPREFIX": str(self._folder), "TMPDIR": str(self._folder)}

    def remove(self) -> None:
        """End what runs in it, and remove it."""
        with suppress(OSError, subprocess.TimeoutExpired):
            none = subprocess.DEVNULL
            command = ["wineserver", "-k"]
            subprocess.run(
                command, env=self.environment(), stdin=none, stderr=none, check=False, timeout=SHUTDOWN_TIMEOUT
            )
        _remove(self._folder)


def _remove_lost(around: Path) -> None:
    for folder in around.glob(f"{platform.node()}-*"):
        with suppress(ProcessLookupError, ValueError, PermissionError):
            # Signal 0 only asks whether the process exists. The name of the
            # machine is in the folder's, as caches are shared over networks.
            os.kill(int(folder.name.split("-")[-2]), 0)
            continue
        _remove(folder)


def _remove(folder: Path) -> None:
    """Remove an installation, and the folder that its server had for its socket."""
    with suppress(OSError):
        place = folder.stat()
        server = f"/tmp/.wine-{os.getuid()}/server-{place.st_dev:x}-{place.st_ino:x}"
        shutil.rmtree(server, ignore_errors=True)
    shutil.rmtree(folder, ignore_errors=True)
