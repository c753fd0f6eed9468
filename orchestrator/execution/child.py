"""The life of a child process: load two FMUs, run the tasks, send the outcomes, end."""

from __future__ import annotations

import os
import signal
import sys
import time
from multiprocessing.connection import Connection
from typing import Any

from ..cosim import trace
from ..cosim.slaves import load, log
from ..errors import BenchmarkError
from .job import Failed, Finished, Job

GOODBYE = "all tasks done"
"""The last message of a child that came to its end; an FMU that calls exit(0) does not send it."""


def main(job: Job, outcomes: Connection, output: Connection, shared: Any) -> None:
    """Run ``job``; outcomes go through the one pipe, whatever the FMUs print or log through the other.

    ``shared`` is the :class:`~orchestrator.execution.launch.SharedTrace` that the parent reads after a crash.
    """
    if os.name == "posix":
        # Ctrl-C is the parent's to handle: inside a Python FMU it would be swallowed and look like a fatal error.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if os.getpgrp() != os.getpid():
            os.setpgid(0, 0)
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
        log.echo_to(2)
    trace.use(trace.Trace(shared.buffer))
    begin = time.perf_counter()
    index = 0
    try:
        _alarm(job.time_limits[0])
        plant, controller = load(job.plant, trace.PLANT), load(job.controller, trace.CONTROLLER)
        for index, task in enumerate(job.tasks):  # noqa: B007 - the handler below needs the index
            _alarm(job.time_limits[index])
            begin = time.perf_counter()
            value = job.work(plant, controller, task)
            outcomes.send(Finished(index, value, time.perf_counter() - begin))
    except BenchmarkError as error:
        outcomes.send(Failed(index, error, time.perf_counter() - begin))
    _alarm(0.0)
    outcomes.send(GOODBYE)
    outcomes.close()
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(0)  # destructors of foreign libraries are no business of ours


def _alarm(limit: float) -> None:
    """Let the system end this process after ``limit`` seconds (0: never), even inside a native loop that hangs."""
    if os.name == "posix":
        signal.setitimer(signal.ITIMER_REAL, limit)
