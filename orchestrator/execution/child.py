"""The life of a child process: load two FMUs, run the tasks, send the outcomes, end."""

from __future__ import annotations

import contextlib
import ctypes
import os
import signal
import sys
import time
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection
from typing import Any

from ..cosim import trace
from ..cosim.slaves import load, log
from ..errors import BenchmarkError
from .family import bind_to_parent
from .job import Failed, Finished, Job
from .messages import send

if sys.platform != "win32":
    import resource

MOST_DESCRIPTORS = 65536
PATIENCE = 10.0
"""Seconds that a child whose tasks are done waits for its parent to end it."""


def main(job: Job, outcomes: Connection, output: Connection, shared: Any) -> None:
    """Run ``job``; outcomes go through the one pipe, whatever the FMUs print or log through the other.

    ``shared`` is the :class:`~orchestrator.execution.shared_trace.SharedTrace` that the parent reads after a crash.
    """
    bind_to_parent()
    if os.name == "posix":
        # Ctrl-C is the parent's to handle: inside a Python FMU it would be swallowed and look like a fatal error.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        if os.getpgrp() != os.getpid():
            os.setpgid(0, 0)
        os.dup2(output.fileno(), 1)
        os.dup2(output.fileno(), 2)
        log.echo_to(2)
        _close_all_but(outcomes.fileno())
        resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    trace.use(trace.Trace(shared.buffer))
    surroundings = Surroundings()
    begin = time.perf_counter()
    index = 0
    try:
        _alarm(job.time_limits[0])
        plant, controller = load(job.plant, trace.PLANT), load(job.controller, trace.CONTROLLER)
        for index, task in enumerate(job.tasks):  # noqa: B007 - the handler below needs the index
            surroundings.restore()
            _alarm(job.time_limits[index])
            begin = time.perf_counter()
            value = job.work(plant, controller, task)
            send(outcomes, Finished(index, value, time.perf_counter() - begin))
    except BenchmarkError as error:
        send(outcomes, Failed(index, error, time.perf_counter() - begin))
    sys.stdout.flush()
    sys.stderr.flush()
    _alarm(PATIENCE)
    if os.name == "posix":
        while True:  # the parent ends us, after it has looked for what the FMUs have started
            signal.pause()
    os._exit(0)  # destructors of foreign libraries are no business of ours


def _close_all_but(descriptor: int) -> None:
    """Close what the process has inherited, such as the pipes between fork server and parent: an FMU that writes into
    all it finds shall find little."""
    resource_tracker._resource_tracker._fd = None  # type: ignore[attr-defined]
    highest = min(resource.getrlimit(resource.RLIMIT_NOFILE)[0], MOST_DESCRIPTORS)
    os.closerange(3, descriptor)
    os.closerange(descriptor + 1, highest)


class Surroundings:
    """What belongs to the process and not to an instance, as it was before the FMUs came: a case that changes it must
    not change the next case's numbers."""

    def __init__(self) -> None:
        self._folder = os.getcwd() if os.path.isdir(os.curdir) else os.sep
        self._mask = os.umask(0o022)
        os.umask(self._mask)
        self._arithmetic = ctypes.create_string_buffer(1024)
        """Rounding mode, flushing of small numbers to zero, traps: C's fenv_t, of some 30 bytes."""
        self._library = _mathematics()
        if self._library is not None:
            self._library.fegetenv(self._arithmetic)

    def restore(self) -> None:
        """Put it back."""
        os.chdir(self._folder)
        os.umask(self._mask)
        if self._library is not None:
            self._library.fesetenv(self._arithmetic)


def _mathematics() -> ctypes.CDLL | None:
    for name in (None, "libm.so.6", "ucrtbase.dll"):
        with contextlib.suppress(OSError, TypeError, AttributeError):
            library = ctypes.CDLL(name)
            library.fesetenv, library.fegetenv  # noqa: B018 - looked up here
            return library
    return None


def _alarm(limit: float) -> None:
    """Let the system end this process after ``limit`` seconds (0: never), even inside a native loop that hangs."""
    if os.name == "posix":
        signal.signal(signal.SIGALRM, signal.SIG_DFL)  # an FMU may have changed it
        signal.pthread_sigmask(signal.SIG_UNBLOCK, {signal.SIGALRM})
        signal.setitimer(signal.ITIMER_REAL, limit)
