"""A helper process that runs jobs for a process which may have no children of multiprocessing's: a Dask worker.

It is started once and then keeps a fork server of its own, so that a job costs no start from nothing.
"""

from __future__ import annotations

import multiprocessing
import subprocess
import sys
import threading
from multiprocessing import connection

from .isolation import run_isolated
from .job import Job, Outcome


class Host:
    """The near end of a host process; it ends when this object or its process does."""

    def __init__(self) -> None:
        self._connection, far = multiprocessing.Pipe()
        command = [sys.executable, "-m", "orchestrator.execution.host", str(far.fileno())]
        self._process = subprocess.Popen(command, stdin=subprocess.DEVNULL, pass_fds=[far.fileno()])
        far.close()

    def run(self, job: Job) -> list[Outcome]:
        """Run ``job`` and return its outcomes; raises :class:`EOFError` where the host process is gone."""
        self._connection.send(job)
        return self._connection.recv()

    def close(self) -> None:
        """End the host process."""
        self._connection.close()
        self._process.wait()


_hosts = threading.local()


def run_hosted(job: Job) -> list[Outcome]:
    """Run ``job`` on this thread's host, which is started where there is none."""
    if not hasattr(_hosts, "host"):
        _hosts.host = Host()
    try:
        return _hosts.host.run(job)
    except (EOFError, OSError):
        del _hosts.host
        raise


def serve(requests: connection.Connection) -> None:
    """The far end: run one job after the other until the near end is gone, also in the middle of a job."""
    while True:
        try:
            job = requests.recv()
        except EOFError:
            return
        stop, done = threading.Event(), threading.Event()
        threading.Thread(target=_watch, args=(requests, stop, done), daemon=True).start()
        outcomes = list(run_isolated(job, stop))
        done.set()
        if stop.is_set():
            return
        requests.send(outcomes)


def _watch(requests: connection.Connection, stop: threading.Event, done: threading.Event) -> None:
    """Nothing is sent during a job: what makes the connection ready then is its end."""
    while not done.is_set():
        if connection.wait([requests], timeout=0.2) and not done.is_set():
            stop.set()
            return


if __name__ == "__main__":
    serve(connection.Connection(int(sys.argv[1])))
