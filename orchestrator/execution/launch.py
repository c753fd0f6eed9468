"""Starting a child process: from a fork server, or as a fresh process in a sandbox."""

from __future__ import annotations

import mmap
import multiprocessing
import os
import pickle
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from multiprocessing import connection, reduction
from pathlib import Path
from typing import Any, Protocol

from ..cosim.trace import SIZE, Place, Trace
from ..errors import InputError
from ..folders import cache_folder
from . import child
from .job import Job


class Process(Protocol):
    """What a started process can be asked for."""

    pid: int

    def exit_code(self) -> int | None:
        """Wait for the end; the exit code, negative for a signal."""

    def kill(self) -> None:
        """End it, and whatever it started."""


@dataclass(frozen=True)
class Child:
    """A running child: the process, the ends of its pipes, and where its simulation is."""

    process: Process
    outcomes: connection.Connection
    output: connection.Connection
    trace: SharedTrace


class SharedTrace:
    """A trace in an unlinked file that parent and child both map: no name is left behind, whoever is killed."""

    def __init__(self, file: int | None = None) -> None:
        if file is None:
            with tempfile.TemporaryFile() as fresh:
                fresh.truncate(SIZE)
                file = os.dup(fresh.fileno())
        self.file = file
        self.buffer = memoryview(mmap.mmap(file, SIZE))

    def __reduce__(self) -> tuple[Any, ...]:
        return _attach, (reduction.DupFd(self.file),)

    def read(self) -> Place:
        """Where the simulation is, or was when the child ended."""
        return Trace(self.buffer).read()

    def close(self) -> None:
        """Give the file back."""
        os.close(self.file)


def _attach(duplicate: Any) -> SharedTrace:
    return SharedTrace(duplicate.detach())


@contextmanager
def started(job: Job) -> Iterator[Child]:
    """A child process that runs ``job``; when the block ends, so does the child.

    It comes from a fork server that has the whole stack loaded (0.04 s); in a sandbox, or where there is no fork
    server, it starts from nothing.
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
            process = stack.enter_context(_sandboxed(job, outcomes_end, output_end, trace))
        else:
            process = _ServedProcess(job, outcomes_end, output_end, trace)
        stack.callback(process.kill)
        outcomes_end.close()
        output_end.close()
        yield Child(process, outcomes, output, trace)


class _ServedProcess:
    """A process from multiprocessing's fork server, or spawned where there is none."""

    def __init__(self, job: Job, outcomes: Any, output: Any, trace: SharedTrace) -> None:
        methods = multiprocessing.get_all_start_methods()
        context: Any = multiprocessing.get_context("forkserver" if "forkserver" in methods else "spawn")
        if "forkserver" in methods:
            context.set_forkserver_preload(["orchestrator.execution.preload"])
        self._process = context.Process(target=child.main, args=(job, outcomes, output, trace), daemon=True)
        self._process.start()
        self.pid = self._process.pid

    def exit_code(self) -> int | None:
        self._process.join()
        return self._process.exitcode

    def kill(self) -> None:
        _kill_group(self.pid)
        self._process.kill()
        self._process.join()


class _FreshProcess:
    """A process started from nothing by a command."""

    def __init__(self, command: list[str], descriptors: tuple[int, int, int], job: Job) -> None:
        output = descriptors[1]
        self._process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=output,
            stderr=output,
            pass_fds=descriptors,
            start_new_session=True,
        )
        self.pid = self._process.pid
        assert self._process.stdin is not None
        pickle.dump(job, self._process.stdin)
        self._process.stdin.close()

    def exit_code(self) -> int | None:
        return self._process.wait()

    def kill(self) -> None:
        _kill_group(self.pid)
        self._process.kill()
        self._process.wait()


@contextmanager
def _sandboxed(job: Job, outcomes: Any, output: Any, trace: SharedTrace) -> Iterator[_FreshProcess]:
    descriptors = (outcomes.fileno(), output.fileno(), trace.file)
    command = [sys.executable, "-m", "orchestrator.execution.fresh", *map(str, descriptors)]
    with tempfile.TemporaryDirectory(prefix="flexible-manipulator-") as scratch:
        yield _FreshProcess([*_sandbox(job, Path(scratch)), *command], descriptors, job)


def _sandbox(job: Job, scratch: Path) -> list[str]:
    """The command line of bubblewrap: no network, everything read-only but /tmp and a copy of the cache."""
    program = shutil.which("bwrap")
    if program is None:
        raise InputError("--sandbox needs bubblewrap (bwrap), which is not installed. Install it, or leave it out.")
    cache = cache_folder()
    copy = scratch / "cache"
    for folder in (cache / "numba", job.plant.folder, job.controller.folder):
        if folder.is_dir():
            shutil.copytree(folder, copy / folder.relative_to(cache), symlinks=True, dirs_exist_ok=True)
    return [
        *(program, "--unshare-all", "--die-with-parent", "--ro-bind", "/", "/", "--dev", "/dev", "--proc", "/proc"),
        *("--tmpfs", "/tmp", "--bind", str(copy), str(cache), "--chdir", "/tmp"),
        *("--setenv", "PYTHONPATH", os.pathsep.join(path for path in sys.path if path)),
        "--",
    ]


def _kill_group(pid: int) -> None:
    if os.name == "posix":
        try:
            os.killpg(pid, signal.SIGKILL)
        except (ProcessLookupError, PermissionError):
            return
