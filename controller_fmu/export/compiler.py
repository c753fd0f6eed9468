"""This machine's C compiler: finding it, and running it on sources that may be a stranger's."""

from __future__ import annotations

import os
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from controller_fmu.export.archive import BuildError

COMPILERS = ("cc", "gcc", "clang")

TIME_LIMIT = 300.0
"""Seconds that a compiler may take."""

MEMORY, FILE = 2 * 1024**3, 1024**3
"""Bytes of the address space of each process of a compiler, and of each file it writes, where the system has limits."""

MOST_TOLD = 65536
"""Bytes that are read of what a compiler says."""

_LIMITED = f"""
import os, resource, sys
for kind, limit in ((resource.RLIMIT_AS, {MEMORY}), (resource.RLIMIT_FSIZE, {FILE})):
    most = resource.getrlimit(kind)[1]
    own = limit if most == resource.RLIM_INFINITY else min(limit, most)
    try:
        resource.setrlimit(kind, (own, own))
    except (ValueError, OSError):  # not every system has every limit
        pass
try:
    os.execvp(sys.argv[1], sys.argv[1:])
except OSError as problem:
    sys.exit(f"{{sys.argv[1]}} cannot be run: {{problem.strerror}}")
"""
"""A process that limits itself and becomes the compiler. Limits cannot be set between fork and exec by a process that
has threads, as a Dask worker has."""


class NoCompilerError(BuildError):
    """This machine has no C compiler."""


def find_compiler() -> list[str] | None:
    """Return the command of the C compiler, from the environment's CC or the usual names; None if absent.

    Raises :class:`BuildError` where CC cannot be read as a command.
    """
    told = os.environ.get("CC", "")
    try:
        wanted = shlex.split(told)
    except ValueError as problem:
        raise BuildError(
            f"the environment's CC is no command: {told} ({problem}); set it to a C compiler, such as "
            f"{COMPILERS[1]}, or unset it"
        ) from None
    candidates = [wanted] if wanted else [[name] for name in COMPILERS]
    return next((command for command in candidates if shutil.which(command[0])), None)


def run_compiler(command: Sequence[str], product: Path, folder: Path | None = None) -> None:
    """Run ``command`` in ``folder`` (the current one if None), which shall write the file ``product``.

    It gets no input, and ends after TIME_LIMIT with all that it has started. Raises :class:`BuildError` with what the
    compiler said, or how it ended, where it fails.
    """
    with tempfile.TemporaryFile() as told:
        # A session of its own: what ends with it are all its parts, which do not hear a Ctrl-C of the terminal either.
        process = subprocess.Popen(
            [*_limits(), *command],
            cwd=folder,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=told,
            start_new_session=True,
        )
        try:
            code = process.wait(TIME_LIMIT)
        except subprocess.TimeoutExpired:
            raise BuildError(f"'{command[0]}' did not end within {TIME_LIMIT:g} s") from None
        finally:
            _end(process)
        told.seek(0)
        words = told.read(MOST_TOLD).decode(errors="replace").strip()
    if code != 0:
        raise BuildError(words or f"'{command[0]}' {_ending(code)} and said nothing")
    if not product.is_file():
        raise BuildError(words or f"'{command[0]}' ended without an error, but wrote nothing: is it a C compiler?")


def _limits() -> list[str]:
    return [sys.executable, "-I", "-S", "-c", _LIMITED] if os.name == "posix" else []


def _end(process: subprocess.Popen[bytes]) -> None:
    """End a compiler that is still at work, and its parts."""
    if process.poll() is None:
        with suppress(ProcessLookupError, PermissionError):
            os.killpg(process.pid, signal.SIGKILL) if os.name == "posix" else process.kill()
        process.wait()


def _ending(code: int) -> str:
    return f"was ended by signal {-code}" if code < 0 else f"ended with exit code {code}"
