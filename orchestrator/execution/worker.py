"""The life of a worker process: load two FMUs, run the tasks, send the outcomes, end."""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import os
import resource
import signal
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import NoReturn

from ..errors import BenchmarkError
from ..fmi import log, trace
from ..fmi.archive import check_files, reopen
from ..fmi.slaves import Slave, load
from .isolation import Isolated
from .messages import Failed, Finished, FmuFiles, Loaded, Order, SharedTrace, error_record, frame, read_frame, write_all
from .process_tree import bind_to_parent

MAX_DESCRIPTORS = 65536

Work = Callable[[Slave, Slave | Isolated, bytes], bytes]


def main(channel: int, output: int, shared: int, folder: str, parent: int) -> NoReturn:
    """Run the order that comes through ``channel`` and send the outcomes back there.

    Whatever the FMUs print goes to ``output``. ``shared`` is the file of the trace and the log that the owner reads
    after a crash. All three are file descriptors. The process works in ``folder`` and ends with the process ``parent``.
    """
    bind_to_parent(parent)
    # Ctrl-C is the owner's to handle: inside a Python FMU it would be swallowed and look like a fatal error.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if os.getpgrp() != os.getpid():
        # A group of its own, so that the owner can end all that an FMU starts.
        os.setpgid(0, 0)
    os.dup2(output, 1)
    os.dup2(output, 2)
    memory = SharedTrace(shared)
    trace.use(trace.Trace(memory.buffer))
    log.use(log.Log(memory.log_buffer))
    # Close what the process has inherited: an FMU that writes into all it finds should find little.
    os.closerange(3, channel)
    os.closerange(channel + 1, min(resource.getrlimit(resource.RLIMIT_NOFILE)[0], MAX_DESCRIPTORS))
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    order = read_frame(channel, Order)
    if order.core >= 0:
        os.sched_setaffinity(0, {order.core})
    os.chdir(folder)  # an empty one: what works in the user's only would fail elsewhere
    module, _, function = order.work.partition(":")
    work: Work = getattr(importlib.import_module(module), function)
    surroundings = Surroundings()
    begin = time.perf_counter()
    index = 0
    try:
        plant = _load(order.plant, trace.PLANT)
        controller = (
            Isolated(order.controller, order.isolated) if order.isolated else _load(order.controller, trace.CONTROLLER)
        )
        write_all(channel, frame(Loaded()))
        for index, task in enumerate(order.tasks):  # noqa: B007 - the handler below needs the index
            # modelica/fmi-guides!19: FMUs change the working folder of
            # their process; others its file mask, or its rounding.
            surroundings.restore()
            begin = time.perf_counter()
            value = work(plant, controller, task)
            broken = plant.broken or controller.broken
            write_all(channel, frame(Finished(index, value, time.perf_counter() - begin, last=broken)))
            if broken:
                break
    except BenchmarkError as error:
        write_all(channel, frame(Failed(index, error_record(error), time.perf_counter() - begin)))
    sys.stdout.flush()
    sys.stderr.flush()
    while True:  # the owner ends us, after it has looked for what the FMUs have started
        signal.pause()


def _load(files: FmuFiles, side: int) -> Slave:
    with contextlib.suppress(FileNotFoundError):  # what is missing, the loader says better
        check_files(files.name, Path(files.folder), files.digests)
    return load(reopen(files.name, files.sha256, files.folder, files.library), side)


class Surroundings:
    """What belongs to the process and not to an instance, as it was before the FMUs came: a case that changes it must
    not change the next case's numbers."""

    def __init__(self) -> None:
        self._folder = os.getcwd()
        self._mask = os.umask(0o022)
        os.umask(self._mask)
        self._arithmetic = ctypes.create_string_buffer(1024)
        """Rounding mode, flushing of small numbers to zero, traps: C's fenv_t, of some 30 bytes."""
        self._library = _mathematics()
        if self._library is not None:
            self._library.fegetenv(self._arithmetic)

    def restore(self) -> None:
        """Put it back."""
        os.makedirs(self._folder, exist_ok=True)  # somebody may have cleaned up temporary files
        os.chdir(self._folder)
        os.umask(self._mask)
        if self._library is not None:
            self._library.fesetenv(self._arithmetic)


def _mathematics() -> ctypes.CDLL | None:
    for name in (None, "libm.so.6"):
        with contextlib.suppress(OSError, AttributeError):
            library = ctypes.CDLL(name)
            library.fesetenv, library.fegetenv  # noqa: B018 - looked up here
            return library
    return None
