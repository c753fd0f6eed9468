"""The process that workers are forked from: it has the whole stack imported, so that a worker starts at once.

It is a process of its own, started from nothing: a worker has nothing of the caller, neither its main module nor its
threads nor its memory. On Linux it adopts whatever outlives a worker, and ends it.
"""

from __future__ import annotations

import errno
import gc
import importlib
import os
import shutil
import signal
import socket
import sys
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from ..cache import note_compiled
from ..errors import InputError
from .interpreter import lean_imports, protect
from .messages import DESCRIPTORS, NUMBER, REQUEST, Described, read_frame, readable, write_all
from .process_tree import adopt_orphans, children

POLL_INTERVAL = 1.0
"""Seconds between two looks whether the owner is still there: a fork of it may hold the socket open."""


@dataclass(frozen=True)
class _Worker:
    """``status`` is the descriptor where its owner waits for its exit code, ``folder`` the one it works in."""

    status: int
    folder: str


def load(module: str) -> None:
    """Import what workers of ``module`` need, and have it compiled by its function ``prepare``, if there is one."""
    with lean_imports():
        importlib.import_module(f"{__package__}.worker")
        prepare = getattr(importlib.import_module(module), "prepare", None)
        if prepare is not None:
            prepare()
    note_compiled(Path(os.environ["NUMBA_CACHE_DIR"]), module)


def main(control: int, owner: int, module: str, scratch: str, protected: int) -> None:
    """Fork a worker for every message that comes through the socket ``control``, until that is closed.

    It also ends, and all workers with it, at SIGTERM and when the process ``owner`` is not its parent any more.
    ``module`` is imported first, and its function ``prepare`` called if there is one. Workers work in folders inside
    ``scratch``, which is removed at the end. If ``protected``, the package is read-only where that can be done.
    """
    # Ctrl-C goes to all processes of the terminal; the owner decides what it means.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.SIG_DFL)  # until there is something to clean up
    workers: dict[int, _Worker] = {}
    try:
        if protected:
            protect()
        adopt_orphans()
        load(module)
        requests, awake = socket.socket(fileno=control), _wake_up()
        # A server whose owner was killed has another parent, and would wait for ever.
        while os.getppid() == owner:
            ready = readable((control, awake), POLL_INTERVAL)
            if awake in ready and signal.SIGTERM in os.read(awake, 4096):
                return
            _report_ended(workers)
            if control in ready:
                message, descriptors, _, _ = socket.recv_fds(requests, len(REQUEST), DESCRIPTORS)
                if not message:
                    return
                _read(read_frame(control, Described))
                _fork(descriptors, workers, scratch)
    finally:
        for pid in workers:
            os.kill(pid, signal.SIGKILL)  # not reaped yet, so it is still the worker
        for pid in workers:
            os.waitpid(pid, 0)
        _end_strays(())
        shutil.rmtree(scratch, ignore_errors=True)


def _wake_up() -> int:
    """Descriptor from which the numbers of the signals that arrive can be read."""
    awake, wake = os.pipe()
    # signal.set_wakeup_fd demands it: a full pipe must not block a handler.
    os.set_blocking(wake, False)
    signal.set_wakeup_fd(wake)
    for number in (signal.SIGCHLD, signal.SIGTERM):
        signal.signal(number, lambda *_: None)
    return awake


def _read(described: Described) -> None:
    """Read the descriptions that the next workers need, once for all of them."""
    from ..fmi.archive import reopen  # FMPy: loaded with the worker, where no garbage is looked for meanwhile

    for fmu in described.fmus:
        with suppress(InputError, OSError):  # the worker says what is wrong
            reopen(fmu.name, fmu.sha256, fmu.folder, fmu.library)
    gc.freeze()  # a worker's look for garbage would copy all of it


def _fork(descriptors: list[int], workers: dict[int, _Worker], scratch: str) -> None:
    if len(descriptors) < DESCRIPTORS:  # this process has too many; the owner sees that its socket is closed
        for descriptor in descriptors:
            os.close(descriptor)
        return
    *inherited, status = descriptors
    try:
        os.makedirs(scratch, exist_ok=True)
        folder = tempfile.mkdtemp(dir=scratch)
        server, pid = os.getpid(), os.fork()
    except OSError as problem:
        _send(status, -(problem.errno or errno.EAGAIN))
        os.close(status)
    else:
        if pid == 0:
            _work(inherited, folder, server)
        workers[pid] = _Worker(status, folder)
        _send(status, pid)
    for descriptor in inherited:
        os.close(descriptor)


def _work(descriptors: list[int], folder: str, server: int) -> None:
    """What the forked process does; it never returns."""
    from .worker import main as work  # loaded before the fork, without what is not needed

    try:
        # Else a signal to the worker would be written into the server's pipe.
        signal.set_wakeup_fd(-1)
        for number in (signal.SIGCHLD, signal.SIGTERM):
            signal.signal(number, signal.SIG_DFL)
        channel, output, shared = descriptors
        work(channel, output, shared, folder, server)
    except BaseException:
        sys.excepthook(*sys.exc_info())
    finally:
        # Not sys.exit: the worker has the server's exit handlers and buffers, which are not its own to run.
        os._exit(1)


def _report_ended(workers: dict[int, _Worker]) -> None:
    """Send the exit codes of the workers that have ended, negative for a signal, and end what they leave behind."""
    with suppress(ChildProcessError):  # there is none left
        while (ended := os.waitpid(-1, os.WNOHANG))[0]:
            pid, state = ended
            # An FMU's own child outlives its worker, and would go on using processor and memory beside the next cases.
            _end_strays(workers)
            if pid in workers:
                worker = workers.pop(pid)
                shutil.rmtree(worker.folder, ignore_errors=True)
                _send(worker.status, os.waitstatus_to_exitcode(state))
                os.close(worker.status)


def _end_strays(workers: dict[int, _Worker] | tuple[()]) -> None:
    """End the children of this process that it has not forked: orphans of workers."""
    for pid in children(os.getpid()):
        if pid not in workers:
            with suppress(ProcessLookupError, PermissionError):
                os.kill(pid, signal.SIGKILL)


def _send(status: int, value: int) -> None:
    with suppress(OSError):  # the owner does not want to know any more
        write_all(status, NUMBER.pack(value))
