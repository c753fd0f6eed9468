"""Starting a child process: from a fork server, or as a fresh process in a sandbox."""

from __future__ import annotations

import multiprocessing
import pickle
import signal
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from multiprocessing import connection, forkserver, resource_tracker
from types import ModuleType
from typing import Any, Protocol

from ..errors import InputError
from . import child, sandbox
from .family import Family
from .job import Job
from .shared_trace import SharedTrace

ATTEMPTS = 3

PATIENCE = 0.2
"""Seconds between two looks whether a start is still wanted, and for one that is not."""


class Stopped(Exception):
    """The child is not wanted any more."""


class Process(Protocol):
    """What a started process can be asked for."""

    family: Family

    def exit_code(self, patience: float) -> int | None:
        """Wait ``patience`` seconds for the end; the exit code, negative for a signal, None where it is still alive."""

    def kill(self) -> None:
        """End it, and whatever it started."""


@dataclass(frozen=True)
class Child:
    """A running child: the process, the ends of its pipes, and where its simulation is."""

    process: Process
    outcomes: connection.Connection
    output: connection.Connection
    trace: SharedTrace


@contextmanager
def started(job: Job, stop: threading.Event) -> Iterator[Child]:
    """A child process that runs ``job``; when the block ends, so does the child.

    It comes from a fork server that has the whole stack loaded (0.02 s until its FMUs are loaded, too); in a sandbox,
    or where there is no fork server, it starts from nothing. Raises :class:`Stopped` where ``stop`` is set before it
    has started.
    """
    with ExitStack() as stack:
        outcomes, outcomes_end = multiprocessing.Pipe(duplex=False)
        output, output_end = multiprocessing.Pipe(duplex=False)
        trace = SharedTrace()
        stack.callback(trace.close)
        for pipe in (outcomes, output):
            stack.callback(pipe.close)
        process: Process
        if job.sandbox:
            process = _FreshProcess(job, outcomes_end, output_end, trace)
        else:
            process = _ServedProcess(job, outcomes_end, output_end, trace, stop)
        stack.callback(process.kill)
        outcomes_end.close()
        output_end.close()
        yield Child(process, outcomes, output, trace)


class _ServedProcess:
    """A process from multiprocessing's fork server, or spawned where there is none."""

    def __init__(self, job: Job, outcomes: Any, output: Any, trace: SharedTrace, stop: threading.Event) -> None:
        methods = multiprocessing.get_all_start_methods()
        context: Any = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        if "forkserver" in methods:
            context.set_forkserver_preload(["orchestrator.execution.preload"])
        for attempt in range(ATTEMPTS):
            self._process = context.Process(target=child.main, args=(job, outcomes, output, trace), daemon=True)
            try:
                _start(self._process, stop)
                break
            except (EOFError, ConnectionError):  # the fork server has been killed; the next start starts another
                if attempt + 1 == ATTEMPTS:
                    raise
                time.sleep(0.1 * (attempt + 1))
            except OSError as problem:
                raise InputError(
                    f"No child process can be started: {problem}. It needs a socket in {tempfile.gettempdir()}: set "
                    "TMPDIR to a folder that can be written and whose path has less than 70 characters."
                ) from problem
        self.family = Family(self._process.pid)

    def exit_code(self, patience: float) -> int | None:
        self._process.join(patience)
        return self._process.exitcode

    def kill(self) -> None:
        self.family.kill()
        self._process.kill()
        self._process.join()


def _start(process: Any, stop: threading.Event) -> None:
    """Start ``process``, which takes seconds where the fork server has to compile before it answers.

    Nothing can interrupt multiprocessing in that, so it waits in a thread of its own, and a Ctrl-C or ``stop``, for
    which :class:`Stopped` is raised, ends a fork server that does not answer.
    """
    start = _Start(process)
    start.start()
    try:
        while not start.done.wait(PATIENCE):
            if stop.is_set():
                raise Stopped
    except BaseException:
        start.abandon()
        raise
    if start.problem is not None:
        raise start.problem


class _Start(threading.Thread):
    """The start of a process. ``problem`` is what it raised, once it is ``done``: a Ctrl-C in ``join`` makes Python
    take a thread for ended."""

    def __init__(self, process: Any) -> None:
        super().__init__(daemon=True)
        self._process, self._wanted = process, True
        self.done = threading.Event()
        self.problem: BaseException | None = None

    def run(self) -> None:
        """Start it. The fork server inherits that SIGINT is held back: a Ctrl-C while it begins would print its
        traceback."""
        try:
            if hasattr(signal, "pthread_sigmask"):
                resource_tracker.ensure_running()  # it would let SIGINT through again when the fork server starts it
                signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
            with _own_main_hidden():
                if self._wanted:
                    self._process.start()
        except BaseException as problem:  # for the thread that waits
            self.problem = problem
        finally:
            self.done.set()

    def abandon(self) -> None:
        """Leave nothing of it."""
        self._wanted = False
        while not self.done.wait(PATIENCE):
            server = getattr(forkserver, "_forkserver", None)
            if pid := getattr(server, "_forkserver_pid", None):
                Family(pid).kill()
        if self._process.pid is not None:
            self._process.kill()
            self._process.join()


_hiding = threading.Lock()


@contextmanager
def _own_main_hidden() -> Iterator[None]:
    """Keep children from importing the main module, which they do in case their work is defined there, where it is one
    of this package's commands: no work is defined there, and the imports take 0.1 s. A user's own script is imported
    in every child, and what is expensive in it belongs below ``if __name__ == "__main__"``."""
    with _hiding:  # several threads start children
        main = sys.modules["__main__"]
        spec = getattr(main, "__spec__", None)
        if spec is not None and spec.name.split(".")[0] == __name__.split(".")[0]:
            sys.modules["__main__"] = ModuleType("__main__")
        try:
            yield
        finally:
            sys.modules["__main__"] = main


class _FreshProcess:
    """A process in a sandbox, started from nothing."""

    def __init__(self, job: Job, outcomes: Any, output: Any, trace: SharedTrace) -> None:
        descriptors = (outcomes.fileno(), output.fileno(), trace.file)
        self._process = subprocess.Popen(
            [*sandbox.command(job), sys.executable, "-m", "orchestrator.execution.fresh", *map(str, descriptors)],
            stdin=subprocess.PIPE,
            stdout=output.fileno(),
            stderr=output.fileno(),
            pass_fds=descriptors,
            start_new_session=True,
            env=sandbox.environment(),
        )
        self.family = Family(self._process.pid)
        assert self._process.stdin is not None
        with suppress(BrokenPipeError):  # it has ended already; the reason is in its output
            pickle.dump(job, self._process.stdin)
            self._process.stdin.close()

    def exit_code(self, patience: float) -> int | None:
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(patience)
        return self._process.returncode

    def kill(self) -> None:
        self.family.kill()
        self._process.kill()
        self._process.wait()
