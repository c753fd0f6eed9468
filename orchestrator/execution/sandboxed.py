"""Entry of a worker process in a sandbox."""

from __future__ import annotations

import os
import shutil

from .interpreter import lean_imports
from .sandbox import given_folder


def fill_cache() -> None:
    """Fill the cache of this sandbox, if it is one."""
    given = given_folder()
    if given.is_dir():
        shutil.copytree(given, given.parent, symlinks=True, dirs_exist_ok=True)


def main(channel: int, output: int, trace: int) -> None:
    """Fill the cache, then run as a worker with these descriptors."""
    fill_cache()
    with lean_imports():
        from . import worker  # not before: its imports load compiled code from the cache

    worker.main(channel, output, trace, os.getcwd(), os.getppid())
