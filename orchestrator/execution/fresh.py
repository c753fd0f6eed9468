"""Entry of a child process that starts from nothing: ``python -m orchestrator.execution.fresh`` with three descriptors.

The job comes through standard input.
"""

from __future__ import annotations

import pickle
import sys
from multiprocessing.connection import Connection

from . import child
from .shared_trace import SharedTrace

if __name__ == "__main__":
    outcomes, output, trace = (int(word) for word in sys.argv[1:])
    child.main(pickle.load(sys.stdin.buffer), Connection(outcomes), Connection(output), SharedTrace(trace))
