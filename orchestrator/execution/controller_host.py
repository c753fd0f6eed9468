"""The process of an isolated controller: one simulation long, with nothing of plant, noise, judge and results in it."""

from __future__ import annotations

import mmap
import os
import resource
import signal
from contextlib import suppress

from .interpreter import lean_imports
from .sandboxed import fill_cache

# Imports inside functions: the process binds itself to its parent before it loads anything.

MAX_FILE_BYTES = 16 * 1024**2
"""Bytes that a file may have which the controller writes, and what it prints and logs."""

OF_THE_USER = {resource.RLIMIT_SIGPENDING: 256, resource.RLIMIT_MSGQUEUE: 0, resource.RLIMIT_MEMLOCK: 1 << 20}
"""Limits of what the kernel counts for a user over all sandboxes: a controller reaches its own first, and so learns
nothing of the others."""


def main() -> None:
    """Run the controller that is asked for through standard input, and answer through standard output."""
    fill_cache()
    with lean_imports():
        import numpy as np

        from ..errors import BenchmarkError, Crash
        from ..fmi import log, trace
        from ..fmi import port as ports
        from ..fmi.archive import reopen
        from ..fmi.library import WINE
        from ..fmi.slaves import load
        from ..loop.controller import prepared
        from ..loop.serving import channel, serve, warm_up
        from .isolation import Begin, Over, Ready, Started
        from .messages import error_record, frame, read_frame, write_all
        from .process_tree import bind_to_parent
        from .seccomp import deny_covert_channels
        from .worker import Surroundings

        bind_to_parent(os.getppid())
        warm_up()
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    # A core dump would be a file of gigabytes, and hold what the process had read.
    resource.setrlimit(resource.RLIMIT_CORE, (0, resource.getrlimit(resource.RLIMIT_CORE)[1]))
    resource.setrlimit(resource.RLIMIT_FSIZE, (MAX_FILE_BYTES, MAX_FILE_BYTES))
    for kind, limit in OF_THE_USER.items():
        hard = resource.getrlimit(kind)[1]
        least = limit if hard == resource.RLIM_INFINITY else min(limit, hard)
        resource.setrlimit(kind, (least, least))
    requests, answers = os.dup(0), os.dup(1)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, 0)
    os.dup2(2, 1)  # what an FMU prints is no answer
    # Standard error is a file that begins with room for the log, which outlives this process there.
    log.use(log.Log(memoryview(mmap.mmap(2, log.SIZE))))
    with suppress(BrokenPipeError, EOFError):
        begin = read_frame(requests, Begin)
        # Before the first byte of the FMU runs, and after all that Python itself needs of the refused calls.
        deny_covert_channels(talking=begin.controller.library == WINE)
        write_all(answers, frame(Started()))
        files, T_s = begin.controller, begin.sample_time
        try:
            # Loading may change how numbers are computed: code of -ffast-math
            # sets flush-to-zero in its library's constructor.
            surroundings = Surroundings()
            slave = load(reopen(files.name, files.sha256, files.folder, files.library), trace.CONTROLLER)
            surroundings.restore()
            with prepared(slave, begin.setup, begin.steady, T_s, begin.stop_time, begin.first) as port:
                write_all(answers, frame(Ready()))
                ended = serve(port, channel(requests, answers), T_s.numerator, T_s.denominator, np.zeros(4))
                if ended == ports.LOST:
                    raise slave.lost()
                write_all(answers, frame(Over(log.last_lines())))
        except Crash as crash:  # of the process that holds its library: this one ends as well, and its owner sees that
            os.write(2, f"{crash}\n".encode())
            os._exit(1)
        except BenchmarkError as error:
            write_all(answers, frame(Over(error=error_record(error))))
