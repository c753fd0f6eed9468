"""Starting a worker process: forked by a fork server, or as a fresh process in a sandbox."""

from __future__ import annotations

import atexit
import logging
import os
import shutil
import socket
import subprocess
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, closing, contextmanager, suppress
from dataclasses import dataclass
from io import FileIO
from pathlib import Path
from tempfile import TemporaryFile
from typing import Protocol

from ..cache import VARIABLE, cache_folder, compiled_code_folder, drop_code, drop_damaged_code, is_compiled
from ..errors import EnvironmentFault
from ..fmi.library import WINE
from . import sandbox
from .interpreter import program
from .job import Job
from .messages import NUMBER, REQUEST, Described, SharedTrace, frame, readable
from .process_tree import ProcessTree, exit_code

ATTEMPTS = 3
"""Fork servers that the start of a worker may cost: one may be killed for no fault of the worker's."""

POLL_INTERVAL = 0.2
"""Seconds between two looks whether a start is still wanted."""

EXIT_TIMEOUT = 5.0
"""Seconds for a process that was killed to be gone."""

LOST = 256
"""In place of an exit code, where the fork server that would know it is gone."""

logger = logging.getLogger(__name__)


class Stopped(Exception):
    """The worker is not wanted any more."""


class Process(Protocol):
    """What a started process can be asked for."""

    tree: ProcessTree

    def exit_code(self, patience: float) -> int | None:
        """Wait ``patience`` seconds for the end; the exit code, negative for a signal, None while it is alive."""

    def kill(self) -> None:
        """End it, and whatever it started."""


@dataclass(frozen=True)
class Child:
    """A running worker: the process, descriptors of its channel and of what it prints, where its simulation is."""

    process: Process
    channel: int
    output: int
    trace: SharedTrace


@contextmanager
def started(job: Job, stop: threading.Event) -> Iterator[Child]:
    """A worker process that runs ``job``; it ends with the block.

    Raises :class:`Stopped` if ``stop`` is set before it has started, :class:`EnvironmentFault` if this machine cannot
    start any.
    """
    with ExitStack() as stack:
        try:
            near, far = map(stack.enter_context, socket.socketpair())
            output, output_end = map(stack.enter_context, map(FileIO, os.pipe(), "rw"))
            trace = stack.enter_context(closing(SharedTrace()))
            ends = far.fileno(), output_end.fileno(), trace.file
            isolated = (*_fence(job), *boot("controller_host")) if job.isolated else ()
            inside = job.sandbox and not job.isolated
            process = _SandboxedProcess(job, ends, stop) if inside else _ForkedProcess(job, ends, stop)
            stack.callback(process.kill)
            far.close()
            output_end.close()
        except OSError as problem:
            raise _cannot_start(problem.strerror or str(problem)) from problem
        with suppress(ConnectionError):  # it has ended already; its output tells why
            _send(near, frame(job.order(isolated)), stop)
        yield Child(process, near.fileno(), output.fileno(), trace)


def _fence(job: Job) -> list[str]:
    """The words before a command that put it in the sandbox of ``job``, if there is to be one."""
    if not job.sandbox:
        return []
    # Of a plant that somebody else steps nothing is shown.
    if job.isolated:
        return sandbox.command((job.controller.folder,), alone=True, talking=job.controller.library == WINE)
    return sandbox.command((job.plant.folder, job.controller.folder))


def _send(channel: socket.socket, data: bytes, stop: threading.Event) -> None:
    """Send all of ``data``, or raise :class:`Stopped` once ``stop`` is set: the other side may be suspended."""
    view = memoryview(data)
    channel.settimeout(POLL_INTERVAL)
    while view:
        if stop.is_set():
            raise Stopped
        with suppress(TimeoutError):
            view = view[channel.send(view) :]


def _cannot_start(reason: str) -> EnvironmentFault:
    return EnvironmentFault(f"No simulation process can be started: {reason}.", "no-process")


def environment() -> dict[str, str]:
    """The environment of a process of this package."""
    places = {VARIABLE: str(cache_folder()), "NUMBA_CACHE_DIR": str(compiled_code_folder())}
    # Else the order of a set of texts is another one in each run, and with it the sum over it in a law in Python.
    return {**os.environ, **places, "PYTHONHASHSEED": "0"}


def boot(module: str, *arguments: int | str) -> list[str]:
    """The command that runs ``main`` of a module of this room with ``arguments``, in an interpreter of its own."""
    return program(f"from {__package__}.{module} import main; main(*{arguments!a})")


def _spawned(
    command: list[str], output: int, kept: Sequence[int], variables: dict[str, str]
) -> subprocess.Popen[bytes]:
    """A process that prints to ``output`` and inherits the descriptors ``kept``.

    In a session of its own, Ctrl-C does not reach it: the owner decides what ends.
    """
    none = subprocess.DEVNULL
    return subprocess.Popen(
        command, stdin=none, stdout=output, stderr=output, pass_fds=kept, env=variables, start_new_session=True
    )


class ForkServer:
    """The near end of a fork server, which ends with this process at the latest."""

    def __init__(self, module: str, protected: bool) -> None:
        self._lock = threading.Lock()
        self._closed, self._words = False, ""
        drop_damaged_code(compiled_code_folder())
        # Numba's files of machine code end so; where there are none, the first start seems to hang.
        if not any(compiled_code_folder().rglob("*.nbc")):
            logger.info("compiling the master loop, once: this takes some ten seconds")
        with ExitStack() as stack:
            self._output = stack.enter_context(TemporaryFile())
            self._control, far = map(stack.enter_context, socket.socketpair())
            self._scratch = tempfile.mkdtemp(prefix="flexible-manipulator-")
            stack.callback(shutil.rmtree, self._scratch, ignore_errors=True)
            command = boot("fork_server", far.fileno(), os.getpid(), module, self._scratch, int(protected))
            self._process = _spawned(command, self._output.fileno(), [far.fileno()], environment())
            far.close()
            self._resources = stack.pop_all()

    def request(self, descriptors: tuple[int, ...], described: Described) -> None:
        """Ask for a worker; raises :class:`OSError` if the server is gone."""
        with self._lock:
            # One message at a time: the frame that follows the byte must not be mixed with another thread's.
            socket.send_fds(self._control, [REQUEST, frame(described)], list(descriptors))

    def close(self) -> str:
        """End the server, and with it all its workers; returns what it printed, which is nothing while it works."""
        with self._lock:
            if not self._closed:
                self._closed = True
                self._process.terminate()
                try:
                    self._process.wait(EXIT_TIMEOUT)
                except subprocess.TimeoutExpired:
                    self._process.kill()
                    self._process.wait()
                self._words = _last_words(self._output.fileno())
                self._resources.close()
            return self._words

    def forget(self) -> None:
        """Close what a fork of its owner has inherited."""
        self._process.returncode = 0  # it is nobody's child there
        self._control.close()
        self._output.close()


_servers: dict[tuple[str, bool, Path, Path], ForkServer] = {}
_servers_lock = threading.Lock()
_compile_lock = threading.Lock()


def _fork_server(module: str, protected: bool) -> ForkServer:
    """The fork server of this process for this module and cache; from a ``protected`` one the package is read-only."""
    key = (module, protected, cache_folder(), compiled_code_folder())
    with _servers_lock:
        if key not in _servers:
            _servers[key] = ForkServer(module, protected)
        return _servers[key]


def start_ahead(module: str) -> None:
    """Start the fork server that workers of ``module`` will need, and do not wait: it imports for half a second, in
    which its owner has imports of its own. What keeps it from starting is said when a worker is wanted."""
    with suppress(OSError, EnvironmentFault):
        _fork_server(module, True)


def _preparing(job: Job) -> str:
    """The module that loads and compiles what workers of ``job`` need."""
    return job.prepared_by or job.work.partition(":")[0]


def _compile(module: str, stop: threading.Event) -> None:
    """Have compiled what a worker in a sandbox needs, if it is not: it can keep none, and would compile on the time of
    its controller, which was told to have a timeout. Raises :class:`Stopped` if ``stop`` is set meanwhile."""
    folder = compiled_code_folder()
    with _compile_lock:
        drop_damaged_code(folder)
        if is_compiled(folder, module):
            return
        logger.info("compiling for the sandbox, once: this takes some ten seconds")
        words = _loaded(module, stop)
        if words is not None:
            drop_code(folder)  # damaged before it was noted what it was
            words = _loaded(module, stop)
        if words is not None:
            raise _cannot_start(f"what it needs cannot be compiled\n  {words}")


def _loaded(module: str, stop: threading.Event) -> str | None:
    """Load ``module`` in a process of its own; what that says if it fails."""
    command = program(f"from {__package__}.fork_server import load; load({module!a})")
    with TemporaryFile() as output:
        process = _spawned(command, output.fileno(), (), environment())
        try:
            while process.poll() is None:
                if stop.wait(POLL_INTERVAL):
                    raise Stopped
        finally:
            process.kill()
            process.wait()
        return None if process.returncode == 0 else _last_words(output.fileno())


def _last_words(output: int) -> str:
    return os.pread(output, 1 << 20, 0)[-2000:].decode(errors="replace").strip()


def _discard(server: ForkServer) -> str:
    """End a server; the next worker gets a new one. Returns its last words."""
    with _servers_lock:
        for key in [key for key, running in _servers.items() if running is server]:
            del _servers[key]
    return server.close()


@atexit.register
def _end_fork_servers() -> None:
    for server in list(_servers.values()):
        _discard(server)


def _forget_fork_servers() -> None:
    global _servers_lock, _compile_lock
    _servers_lock, _compile_lock = threading.Lock(), threading.Lock()  # another thread may have held them at the fork
    for server in _servers.values():
        server.forget()
    _servers.clear()


# multiprocessing and notebooks fork: two processes on one control socket would take each other's workers.
os.register_at_fork(after_in_child=_forget_fork_servers)


class _ForkedProcess:
    """A worker forked by the fork server."""

    def __init__(self, job: Job, descriptors: tuple[int, ...], stop: threading.Event) -> None:
        self._code: int | None = None
        words = ""
        for attempt in range(ATTEMPTS):
            if attempt == ATTEMPTS - 1:
                drop_code(compiled_code_folder())  # it may be damaged, and be what each of them ends by
            # A worker with an isolated controller starts a sandbox, which takes rights that a protected one gives up.
            server = _fork_server(_preparing(job), not job.isolated)
            self._status, far = socket.socketpair()
            try:
                with far, suppress(OSError):
                    server.request((*descriptors, far.fileno()), job.described())
                pid = self._number(stop)
            except BaseException:  # interrupted, or not wanted any more
                self._status.close()
                raise
            if pid is not None and pid > 0:
                self.tree = ProcessTree(pid)
                return
            self._status.close()
            if pid is not None:
                raise OSError(-pid, os.strerror(-pid))
            words = _discard(server)
        raise _cannot_start(f"the one that starts them ends at once\n  {words}")

    def _number(self, stop: threading.Event) -> int | None:
        """The worker's process number, or a negative error number; None if the server is gone."""
        while not readable([self._status.fileno()], POLL_INTERVAL):
            if stop.is_set():
                raise Stopped
        return _received(self._status)

    def exit_code(self, patience: float) -> int | None:
        if self._code is None and self._status.fileno() >= 0 and readable([self._status.fileno()], patience):
            code = _received(self._status)
            self._code = LOST if code is None else code
        return self._code

    def kill(self) -> None:
        self.tree.kill()
        self.exit_code(EXIT_TIMEOUT)
        self._status.close()


def _received(status: socket.socket) -> int | None:
    with suppress(OSError):
        data = status.recv(NUMBER.size, socket.MSG_WAITALL)
        if len(data) == NUMBER.size:
            return int(NUMBER.unpack(data)[0])
    return None


class _SandboxedProcess:
    """A worker in a sandbox, started from nothing."""

    def __init__(self, job: Job, descriptors: tuple[int, ...], stop: threading.Event) -> None:
        _compile(_preparing(job), stop)
        command = [*_fence(job), *boot("sandboxed", *descriptors)]
        self._process = _spawned(command, descriptors[1], descriptors, sandbox.environment(environment()))
        self.tree = ProcessTree(self._process.pid)

    def exit_code(self, patience: float) -> int | None:
        return exit_code(self._process, patience)

    def kill(self) -> None:
        self.tree.kill()
        self._process.kill()
        self._process.wait()
