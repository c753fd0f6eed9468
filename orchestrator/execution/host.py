"""A helper process that runs jobs for a process which may have no children of multiprocessing's: a Dask worker.

It is started once and then keeps a fork server of its own, so that a job costs no start from nothing.
"""

from __future__ import annotations

import multiprocessing
import pickle
import platform
import subprocess
import sys
import threading
from multiprocessing import connection

from ..errors import BenchmarkError
from .isolation import run_isolated
from .job import Job, Outcome

ATTEMPTS = 2
"""Hosts that a job may cost: one may be killed for no fault of the job's."""


class Host:
    """The near end of a host process; it ends when this object or its process does."""

    def __init__(self) -> None:
        self._connection, far = multiprocessing.Pipe()
        command = [sys.executable, "-m", "orchestrator.execution.host", str(far.fileno())]
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=[far.fileno()])
        far.close()

    def run(self, job: Job) -> list[Outcome] | Exception:
        """Run ``job`` and return its outcomes, or the error that came instead; raises :class:`EOFError` or
        :class:`OSError` where the host process is gone."""
        self._connection.send(job)
        return self._connection.recv()

    def close(self) -> None:
        """End the host process, which stops what it runs."""
        self._connection.close()
        self._process.wait()


_hosts = threading.local()


def run_hosted(job: Job) -> list[Outcome]:
    """Run ``job`` on this thread's host, which is started where there is none, and once more where it is gone.

    Raises what :func:`~orchestrator.execution.isolation.run_isolated` raises there.
    """
    for _ in range(ATTEMPTS):
        if not hasattr(_hosts, "host"):
            _hosts.host = Host()
        try:
            answer = _hosts.host.run(job)
        except (EOFError, OSError):
            _hosts.host.close()
            del _hosts.host
            continue
        if isinstance(answer, Exception):
            raise answer
        return answer
    raise BenchmarkError(
        f"On {platform.node()} the process that starts the simulations was killed {ATTEMPTS} times in one job. Look "
        "there for what did that, such as a system that is out of memory."
    )


def serve(requests: connection.Connection) -> None:
    """The far end: run one job after the other until the near end is gone, also in the middle of a job."""
    while True:
        try:
            job = requests.recv()
        except (EOFError, OSError):
            return
        stop, done = threading.Event(), threading.Event()
        threading.Thread(target=_watch, args=(requests, stop, done), daemon=True).start()
        try:
            answer: list[Outcome] | Exception = list(run_isolated(job, stop))
        except Exception as problem:  # the near end's to tell: it knows the user
            answer = _portable(problem)
        done.set()
        if stop.is_set():
            return
        requests.send(answer)


def _portable(problem: Exception) -> Exception:
    """``problem``, or where it cannot be sent to another process, what it says."""
    try:
        pickle.loads(pickle.dumps(problem))
        return problem
    except Exception:
        return BenchmarkError(f"{type(problem).__name__}: {problem}")


def _watch(requests: connection.Connection, stop: threading.Event, done: threading.Event) -> None:
    """Nothing is sent during a job: what makes the connection ready then is its end."""
    while not done.is_set():
        if connection.wait([requests], timeout=0.2) and not done.is_set():
            stop.set()
            return


if __name__ == "__main__":
    serve(connection.Connection(int(sys.argv[1])))
