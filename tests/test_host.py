"""The helper process of a Dask worker: what goes wrong in it reaches the worker, and its end costs nothing."""

from __future__ import annotations

import sys
import threading
from contextlib import suppress

import psutil
import pytest
from hostile.commands import kill, wait_for

from orchestrator.cosim.archive import open_archive
from orchestrator.errors import BenchmarkError, InputError
from orchestrator.execution import host
from orchestrator.execution.job import Finished, Job

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="descriptors of POSIX")


@pytest.fixture
def job(plant_file, pid_file, monkeypatch):
    """A job that prints a line; the host of this thread ends with the test."""
    monkeypatch.setattr(host, "_hosts", threading.local())
    yield Job(open_archive(plant_file), open_archive(pid_file), (1,), print, (60.0,))
    if hasattr(host._hosts, "host"):
        host._hosts.host.close()


def processes() -> list[psutil.Process]:
    """The hosts of this process."""
    found = []
    for child in psutil.Process().children():
        with suppress(psutil.Error):  # one of another test may be a zombie
            if "orchestrator.execution.host" in child.cmdline():
                found.append(child)
    return found


def test_an_error_comes_back_and_the_host_stays(job, monkeypatch):
    with monkeypatch.context() as patch:
        patch.setenv("PATH", "/nonexistent")
        with pytest.raises(InputError, match="--sandbox needs bubblewrap"):
            host.run_hosted(Job(**{**vars(job), "sandbox": True}))
    (before,) = processes()
    (outcome,) = host.run_hosted(job)
    assert isinstance(outcome, Finished)
    assert processes() == [before]


def test_a_host_that_was_killed_is_started_again(job):
    host.run_hosted(job)
    (victim,) = processes()
    kill(victim)
    assert wait_for(lambda: victim.status() == psutil.STATUS_ZOMBIE)
    (outcome,) = host.run_hosted(job)
    assert isinstance(outcome, Finished)
    assert victim not in processes()


def test_a_host_that_is_killed_each_time_is_told(job, monkeypatch):
    starts = []

    class Doomed(host.Host):
        def __init__(self) -> None:
            super().__init__()
            starts.append(self._process.kill())
            self._process.wait()

    monkeypatch.setattr(host, "Host", Doomed)
    with pytest.raises(BenchmarkError, match="was killed 2 times in one job. Look there"):
        host.run_hosted(job)
    assert len(starts) == host.ATTEMPTS


def test_an_error_that_cannot_be_sent_is_told():
    class Local(Exception):
        pass

    found = host._portable(Local("of this function alone"))
    assert isinstance(found, BenchmarkError)
    assert str(found) == "Local: of this function alone"
