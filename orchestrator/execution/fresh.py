"""Entry of a sandboxed child process: ``python -m orchestrator.execution.fresh`` with three descriptors.

The job comes through standard input.
"""

from __future__ import annotations

import pickle
import shutil
import sys
from multiprocessing.connection import Connection

from .sandbox import given_folder


def main(outcomes: int, output: int, trace: int) -> None:
    """Fill the cache of this sandbox, then live the life of a child with these descriptors."""
    given = given_folder()
    if given.is_dir():
        shutil.copytree(given, given.parent, symlinks=True, dirs_exist_ok=True)
    from . import child  # not before: its imports load compiled code from the cache
    from .shared_trace import SharedTrace

    child.main(pickle.load(sys.stdin.buffer), Connection(outcomes), Connection(output), SharedTrace(trace))


if __name__ == "__main__":
    main(*(int(word) for word in sys.argv[1:]))
