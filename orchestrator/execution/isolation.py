"""A controller in a process of its own, seen from the process of plant and judge: q_m goes there, u_m comes back."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from fractions import Fraction
from functools import partial

import numpy as np

from ..codec import Finite, Malformed, NonNegative, Struct
from ..errors import BenchmarkError, Crash, EnvironmentFault, FmuError, InputError
from ..fmi import log, port, trace
from ..fmi.archive import reopen
from ..fmi.slaves import CLASSES
from ..loop.controller import Steady
from ..loop.scenario import Pair
from ..loop.setup import Setup
from . import sandbox
from .messages import OVERHEAD, ErrorRecord, FmuFiles, error_of, frame, read_frame, write_all
from .process_tree import FOREIGN_SIGNALS, ProcessTree, end_of, exit_code
from .time_limit import end_within

EXIT_TIMEOUT = 1.0
"""Seconds that a process that gives no answer may go on, computing or waiting, before it is said so."""


START_PAUSES = (0.0, 0.5, 2.0, 8.0)
"""Seconds before each attempt to start a process. It has seen nothing of the draws before it loads the FMU."""

TAIL_BYTES = 8192
"""Bytes of what a controller's process prints that are handed on."""


class Begin(Struct, frozen=True):
    """What the process of a controller receives: the FMU, its setup, the steady state and the times [s]."""

    controller: FmuFiles
    setup: Setup
    steady: Steady
    sample_time: Fraction
    stop_time: NonNegative
    first: tuple[Finite, Finite] | None


class Started(Struct, frozen=True, tag=True):
    """It has begun, and nothing of the FMU has run yet: until here, no end of it is the controller's."""


class Ready(Struct, frozen=True, tag=True):
    """It is initialized, and answers steps from now on."""


class Over(Struct, frozen=True, tag=True):
    """It has ended, with what it said last, or failed."""

    lines: tuple[str, ...] = ()
    error: ErrorRecord | None = None


class Isolated:
    """A controller that a new process loads for each simulation, so that none uses data of another.

    ``command`` starts such a process. What comes from it is two numbers per sample, and messages checked against their
    type.
    """

    broken = False  # whatever a process answers, the next simulation has another one

    def __init__(self, files: FmuFiles, command: tuple[str, ...]) -> None:
        self.archive = reopen(files.name, files.sha256, files.folder, files.library)
        self.calls = CLASSES[self.archive.major_version, self.archive.kind].calls
        self._files, self._command = files, command

    @contextmanager
    def prepared(
        self, setup: Setup, steady: Steady, sample_time: Fraction, stop_time: float, first: Pair | None
    ) -> Iterator[port.Port]:
        """A process with an initialized instance; it ends with the block."""
        trace.current.note(trace.CONTROLLER, "starting its process")
        seen = None if first is None else (float(first[0]), float(first[1]))
        begin = Begin(self._files, setup, steady, sample_time, stop_time, seen)
        with _printed() as printed, self._started(begin, printed) as process:
            try:
                self._reply(Ready)
                trace.current.expect(trace.CONTROLLER, tuple(self.calls.values()))
                yield self._port()
            finally:
                # Before what it printed is read: it may print without end.
                process.kill()
                _hand_on(printed)

    def _started(self, begin: Begin, printed: int) -> subprocess.Popen[bytes]:
        """A process that is about to load the FMU.

        Raises :class:`EnvironmentFault` where none can be started. While a user had no more processes for a moment,
        bubblewrap could start none, which counted as the controller's crash: a PID had no place by that.
        """
        pipe, variables = subprocess.PIPE, sandbox.environment(os.environ)
        for pause in START_PAUSES:
            time.sleep(pause)
            try:
                process = subprocess.Popen(
                    self._command, stdin=pipe, stdout=pipe, stderr=printed, env=variables, bufsize=0
                )
            except OSError:
                continue
            assert process.stdin is not None and process.stdout is not None
            self._process, self._requests = process, process.stdin.fileno()
            self._answers = process.stdout.fileno()
            try:
                write_all(self._requests, frame(begin))
                read_frame(self._answers, Started, OVERHEAD)
                return process
            except (EOFError, OSError, Malformed):
                with process:
                    process.kill()
        # Nothing of an FMU is in it, and without it nobody could tell what this machine lacks.
        words = os.pread(printed, TAIL_BYTES, log.SIZE).decode(errors="replace").strip()
        raise EnvironmentFault(f"No process can be started for the controller.\n  {words}".rstrip(), "no-process")

    def messages(self) -> tuple[str, ...]:
        """What the instance said last; it ends."""
        with suppress(FmuError, Crash):
            return self._end(port.LEAVE).lines
        return ()

    def terminate(self) -> None:
        """Do nothing: after its last torque, nothing that it does may change the case. Its process is killed."""

    def lost(self) -> Crash:
        """What became of its process, which gives no answer."""
        code = end_within(EXIT_TIMEOUT, partial(exit_code, self._process), ProcessTree(self._process.pid))
        if code is None:
            words, name = "process sent what is no answer", ""
        else:
            words, name = end_of(code, self._command[0] != sys.executable)
        trace.use(trace.Trace())  # the one that its owner reads stays at the place where this happened
        return Crash(f"the controller's {words}", "killed" if name in FOREIGN_SIGNALS else "")

    def _end(self, how: float) -> Over:
        return self._ask(lambda: write_all(self._requests, np.array([how, 0.0, 0.0]).tobytes()), Over)

    def _ask(self, send: Callable[[], None], kind: type[Ready | Over]) -> Over:
        """Send something and wait for a reply of this ``kind``; raises what came instead."""
        try:
            send()
        except OSError:
            raise self.lost() from None
        return self._reply(kind)

    def _reply(self, kind: type[Ready | Over]) -> Over:
        """Wait for a reply of this ``kind``; raises what came instead."""
        try:
            reply = read_frame(self._answers, Ready | Over, OVERHEAD)  # type: ignore[arg-type]  # a union of types
        except (EOFError, OSError, Malformed):
            raise self.lost() from None
        if isinstance(reply, Over) and reply.error is not None:
            raise _own(reply.error)
        if not isinstance(reply, kind):
            raise self.lost()
        return reply if isinstance(reply, Over) else Over()

    def _port(self) -> port.Port:
        pair = (0, 0)
        unconnected = port.unconnected(pair, 2, pair, 2)
        unconnected.functions[port.REQUESTS], unconnected.functions[port.ANSWERS] = self._requests, self._answers
        return unconnected._replace(
            stepping=port.REMOTE,
            set_values=port.c_function("write"),
            get_values=port.c_function("read"),
            side=trace.CONTROLLER,
            trace=trace.current.words,
        )


def _own(record: ErrorRecord) -> BenchmarkError:
    """The error that a controller's process reports: of its input or of the FMU. It cannot blame this machine."""
    told = error_of(record)
    # A controller may write any error into the pipe. Were it an EnvironmentFault, it
    # would buy a second try with the draws that it has seen.
    return told if isinstance(told, InputError | FmuError) else FmuError(record.message)


@contextmanager
def _printed() -> Iterator[int]:
    """The file for what a controller's process prints, behind its log. It is that process's own: what several processes
    inherit, one may mark for the next."""
    with tempfile.TemporaryFile(buffering=0) as file:
        file.truncate(log.SIZE)
        file.seek(log.SIZE)
        yield file.fileno()


def _hand_on(printed: int) -> None:
    """Print the end of what a controller's process has printed, and keep what it has logged."""
    # The first bytes are the log, which the process maps.
    begin = max(os.fstat(printed).st_size - TAIL_BYTES, log.SIZE)
    write_all(2, os.pread(printed, TAIL_BYTES, begin))
    log.current.take(log.Log(os.pread(printed, log.SIZE, 0).ljust(log.SIZE, b"\0")))
