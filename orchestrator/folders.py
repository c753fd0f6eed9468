"""Where extracted FMUs and compiled code are kept between runs, and the names of what is made from sources."""

from __future__ import annotations

import atexit
import functools
import hashlib
import os
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

import platformdirs

from .errors import InputError

VARIABLE = "FLEXIBLE_MANIPULATOR_CACHE"
"""Environment variable that moves the cache elsewhere."""


def cache_folder() -> Path:
    """The user's cache folder for this program, created where it is missing.

    Where it cannot be written, a temporary folder takes its place for this process and its children, which find it in
    the environment. Raises :class:`InputError` where there is no place for that either.
    """
    wanted = os.environ.get(VARIABLE) or platformdirs.user_cache_dir("flexible-manipulator", appauthor=False)
    return _writable(Path(wanted).absolute())  # children may have another current folder


@functools.cache
def _writable(wanted: Path) -> Path:
    """``wanted``, or what takes its place, with a line that says so."""
    try:
        wanted.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=wanted).close()
        return wanted
    except OSError as problem:
        reason = f"The cache folder {wanted} cannot be written ({problem.strerror or problem})"
    way_out = f"Set {VARIABLE} to a folder that can be written."
    try:
        folder = tempfile.mkdtemp(prefix="flexible-manipulator-")
    except OSError:
        raise InputError(f"{reason}, and there is no temporary folder either. {way_out}") from None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    os.environ[VARIABLE] = folder
    print(f"warning: {reason}: this run compiles everything anew, in {folder}. {way_out}", file=sys.stderr)
    return Path(folder)


def source_hash(folders: Iterable[Path]) -> str:
    """SHA-256 of the names and contents of all files in ``folders``, without compiled code. What is made from them
    is named by it, so nothing stale is ever taken for the new."""
    digest = hashlib.sha256()
    for folder in folders:
        for source in sorted(path for path in folder.rglob("*") if path.is_file()):
            if "__pycache__" not in source.parts:
                digest.update(f"{folder.name}/{source.relative_to(folder).as_posix()}\0".encode())
                digest.update(hashlib.sha256(source.read_bytes()).digest())
    return digest.hexdigest()
