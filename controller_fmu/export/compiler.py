"""This machine's C compiler: finding it, and running it on sources that may be a stranger's."""

from __future__ import annotations

import math
import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from contextlib import suppress
from pathlib import Path

import fmpy

from controller_fmu.errors import CompilerError, NoCompilerError, PlatformError
from controller_fmu.export.platforms import REMEDY, cross_compilers

COMPILERS = ("cc", "gcc", "clang")

TIME_LIMIT = 300.0
"""Seconds of processor time that each process of a compiler may use, where the system has limits."""

HANG_LIMIT = 3000.0
"""Seconds of wall time that a compiler may take at least: far more, since other processes may need the processor."""

MEMORY, FILE = 2 * 1024**3, 1024**3
"""Bytes of the address space of each process of a compiler, and of each file it writes, where the system has limits."""

MESSAGE_SIZE = 65536
"""Bytes of a compiler's messages that are read."""

_LIMITED = f"""
import os, resource, sys
seconds = int(sys.argv.pop(1))
for kind, limit in ((resource.RLIMIT_AS, {MEMORY}), (resource.RLIMIT_FSIZE, {FILE}), (resource.RLIMIT_CPU, seconds)):
    most = resource.getrlimit(kind)[1]
    soft = limit if most == resource.RLIM_INFINITY else min(limit, most)
    # At the soft limit of processor time SIGXCPU ends a process, at the hard one SIGKILL, as others might.
    resource.setrlimit(kind, (soft, most if kind == resource.RLIMIT_CPU else soft))
try:
    os.execvp(sys.argv[1], sys.argv[1:])
except OSError as problem:
    sys.exit(f"{{sys.argv[1]}} cannot be run: {{problem.strerror}}")
"""
"""A process that limits itself and becomes the compiler. Limits cannot be set between fork and exec by a process that
has threads, as a Dask worker has."""


def find_compiler() -> list[str] | None:
    """Return the command of the C compiler; None if there is none.

    It is the environment's CC, or the first of the usual names, or the compiler in the package ``ziglang``. Raises
    :class:`CompilerError` if CC cannot be read as a command.
    """
    chosen = os.environ.get("CC", "")
    try:
        given = shlex.split(chosen)
    except ValueError as problem:
        what = f"the environment variable CC is not a command: {chosen} ({problem})"
        remedy = f"set it to a C compiler, such as {COMPILERS[1]}, or unset it"
        raise CompilerError(what, value=chosen, remedy=remedy) from None
    candidates = [given] if given else [[name] for name in COMPILERS]
    compiler = next((command for command in candidates if shutil.which(command[0])), None)
    if compiler is None and not given:
        with suppress(NoCompilerError, PlatformError):
            return cross_compilers((fmpy.platform_tuple,))[fmpy.platform_tuple]
    return compiler


def require_compiler() -> list[str]:
    """Return what :func:`find_compiler` finds; raises :class:`NoCompilerError` if there is none."""
    compiler = find_compiler()
    if compiler is None:
        remedy = f"install one ({', '.join(COMPILERS)}, or {REMEDY}), or set the environment variable CC"
        raise NoCompilerError("no C compiler found", value=os.environ.get("CC", ""), remedy=remedy)
    return compiler


def run_compiler(
    command: Sequence[str],
    product: Path,
    folder: Path | None = None,
    time_limit: float | None = None,
    environment: Mapping[str, str] | None = None,
) -> None:
    """Run ``command``, which writes the file ``product``, in ``folder`` (the current one if None) and in this process's
    ``environment`` if that is None.

    It gets no input. It is ended together with all that it has started if one of its processes has used ``time_limit``
    [s] of processor time (TIME_LIMIT if None), or after HANG_LIMIT.
    Raises :class:`CompilerError` with its messages, or with how it ended, if it fails.
    """
    seconds = math.ceil(TIME_LIMIT if time_limit is None else time_limit)
    limit = max(HANG_LIMIT, seconds)
    with tempfile.TemporaryFile() as messages:
        # In a session of its own all its parts can be ended, and none of them receives a Ctrl-C of the terminal.
        process = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _LIMITED, str(seconds), *command],
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=messages,
            start_new_session=True,
        )
        try:
            code = process.wait(limit)
        except subprocess.TimeoutExpired:
            raise CompilerError(f"'{command[0]}' did not end within {limit:g} s", value=command[0]) from None
        finally:
            if process.poll() is None:  # end it, and its parts
                with suppress(ProcessLookupError, PermissionError):
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        messages.seek(0)
        words = messages.read(MESSAGE_SIZE).decode(errors="replace").strip()
    if -code == getattr(signal, "SIGXCPU", None):
        raise CompilerError(f"'{command[0]}' needed more than {seconds} s of processor time", value=command[0])
    if code != 0:
        ended = f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
        raise CompilerError(words or f"'{command[0]}' {ended} without a message", value=command[0])
    if not product.is_file() or product.stat().st_size == 0:
        what = words or f"'{command[0]}' ended without an error, but wrote nothing: is it a C compiler?"
        raise CompilerError(what, value=command[0])
