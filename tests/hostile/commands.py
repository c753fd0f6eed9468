"""The evaluation as a command, to be interrupted, killed and run again."""

import os
import signal
import sqlite3
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

import psutil

from orchestrator.execution import store

ROOT = Path(__file__).resolve().parents[2]
NOISE, CASES = ("--only", "c0[0-6].*.noise"), 21
"""Cases of the protocol "paper" that are simulated in some hundredths of a second each, and how many they are."""


def command(folder: Path, *arguments: str) -> list[str]:
    """The command that evaluates into ``folder``."""
    return [sys.executable, "-m", "orchestrator.evaluate", *arguments, "--no-report", "--output-dir", str(folder)]


@contextmanager
def started(
    arguments: Sequence[str], folder: Path = ROOT, environment: Mapping[str, str] | None = None, **options: Any
) -> Iterator[subprocess.Popen[str]]:
    """A command in a session of its own, in ``folder`` and with ``environment`` added; when the block ends, so does the
    whole session."""
    streams = dict.fromkeys(("stdout", "stderr"), subprocess.PIPE) | {"stdin": subprocess.DEVNULL, "text": True}
    surroundings = {**os.environ, "PYTHONPATH": str(ROOT), **(environment or {})}
    process = subprocess.Popen(arguments, cwd=folder, env=surroundings, start_new_session=True, **(streams | options))
    try:
        with process:
            try:
                yield process
            finally:
                end_session(process.pid)
    finally:
        end_session(process.pid)


def finished(arguments: Sequence[str], folder: Path = ROOT, **options: Any) -> subprocess.CompletedProcess[str]:
    """A command that ran to its end; there must be no traceback in what it says."""
    with started(arguments, folder, **options) as process:
        output, errors = process.communicate()
        assert "Traceback" not in errors + output, errors
        return subprocess.CompletedProcess(arguments, process.returncode, output, errors)


def end_session(session: int) -> None:
    """Kill all processes of a session."""
    for member in session_members(session):
        with suppress(psutil.Error):
            member.kill()


def session_members(session: int) -> list[psutil.Process]:
    """Living processes that a command has started, in its session or in one of a fork server."""
    found = _of_session(session)
    for server in fork_servers(session):
        found += [each for each in _of_session(server.pid) if each not in found]
    return found


def _of_session(session: int) -> list[psutil.Process]:
    found = []
    for process in psutil.process_iter():
        with suppress(psutil.Error, ProcessLookupError):
            if os.getsid(process.pid) == session and process.status() != psutil.STATUS_ZOMBIE:
                found.append(process)
    return found


_servers: dict[int, set[psutil.Process]] = {}


def fork_servers(session: int) -> list[psutil.Process]:
    """The living fork servers of a command, whoever is their parent by now; they must be asked for while it lives."""
    known = _servers.setdefault(session, set())
    for child in _descendants(session):
        with suppress(ProcessLookupError):
            if os.getsid(child.pid) == child.pid and "fork_server" in command_line(child):
                known.add(child)
    return [server for server in known if command_line(server)]


def command_line(process: psutil.Process) -> str:
    """The command line of a living process; empty for one that has ended, be it between two looks."""
    with suppress(psutil.Error):
        if process.is_running():
            return " ".join(process.cmdline())
    return ""


def simulations(session: int) -> list[psutil.Process]:
    """The processes that hold FMUs."""
    return [child for server in fork_servers(session) for child in _children(server.pid)]


def _descendants(pid: int) -> Iterator[psutil.Process]:
    for child in _children(pid):
        yield child
        yield from _descendants(child.pid)


def _children(pid: int) -> list[psutil.Process]:
    """From the kernel's own list on Linux: psutil looks through all processes, and on a busy machine that takes longer
    than a simulation lives."""
    found: list[psutil.Process] = []
    with suppress(psutil.Error, OSError):
        if not os.path.isdir("/proc/self/task"):
            return psutil.Process(pid).children()
        for thread in os.listdir(f"/proc/{pid}/task"):
            with suppress(OSError), open(f"/proc/{pid}/task/{thread}/children", encoding="ascii") as listed:
                for child in listed.read().split():
                    with suppress(psutil.Error):
                        found.append(psutil.Process(int(child)))
    return found


GUARD = 1800.0
"""Seconds of wall time after which a test has failed that waits for something: no machine is so busy."""


def wait_for(condition: Any, patience: float = GUARD, every: float = 0.02) -> bool:
    """Wait until ``condition()``; whether it came true."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(every)
    return bool(condition())


def stored(folder: Path) -> int:
    """Rows in the store of a folder."""
    with suppress(sqlite3.Error), closing(sqlite3.connect(f"file:{folder / store.FILE}?mode=ro", uri=True)) as found:
        return int(found.execute("SELECT count(*) FROM records").fetchone()[0])
    return 0


def kill(process: subprocess.Popen[str] | psutil.Process) -> None:
    """kill -9."""
    with suppress(psutil.Error, ProcessLookupError):
        process.send_signal(signal.SIGKILL)
