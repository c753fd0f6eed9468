"""Entry of a worker process in a sandbox."""

from __future__ import annotations

import os
import shutil

from .interpreter import lean_imports
from .sandbox import TMPFS_BYTES, given_folder


def fill_cache() -> None:
    """Fill the cache of this sandbox, if it is one."""
    given = given_folder()
    if given.is_dir():
        shutil.copytree(given, given.parent, symlinks=True, copy_function=_bring, dirs_exist_ok=True)


def _bring(source: str, target: str) -> None:
    """Copy a file, which an FMU may write, or link to it if less than half of the sandbox's memory would be left."""
    # An archive may have 2 GB of resources: copied, those of more than 250 MB ended the process before it began.
    room = os.statvfs(os.path.dirname(target))
    if os.stat(source).st_size > room.f_bavail * room.f_frsize - TMPFS_BYTES // 2:
        os.symlink(source, target)
    else:
        shutil.copy2(source, target)


def main(channel: int, output: int, trace: int) -> None:
    """Fill the cache, then run as a worker with these descriptors."""
    fill_cache()
    with lean_imports():
        from . import worker  # not before: its imports load compiled code from the cache

    worker.main(channel, output, trace, os.getcwd(), os.getppid())
