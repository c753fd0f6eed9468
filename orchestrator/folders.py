"""Where extracted FMUs and compiled code are kept between runs, and the names of what is made from sources."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterable
from pathlib import Path

import platformdirs

VARIABLE = "FLEXIBLE_MANIPULATOR_CACHE"
"""Environment variable that moves the cache elsewhere."""


def cache_folder() -> Path:
    """The user's cache folder for this program; not created here."""
    return Path(os.environ.get(VARIABLE) or platformdirs.user_cache_dir("flexible-manipulator", appauthor=False))


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
