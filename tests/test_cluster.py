"""A real Dask scheduler with two worker processes on loopback: the same numbers as here, and nothing is ever lost."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import psutil
import pytest
from conftest import build_or_skip
from hostile.commands import (
    NOISE,
    ROOT,
    command,
    end_session,
    finished,
    kill,
    session_members,
    simulations,
    started,
    wait_for,
)
from hostile.fmus import Fault, hostile_fmu

from orchestrator import evaluate
from orchestrator.commands import EXIT_BAD_INPUT, guarded
from orchestrator.cosim.archive import open_archive
from orchestrator.errors import InputError
from orchestrator.execution import cluster
from orchestrator.execution.job import Finished, Job

distributed = pytest.importorskip("distributed", reason="distributed (Dask) is not installed: pip install distributed")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sessions of POSIX")

LOOPBACK = ("--host", "127.0.0.1", "--no-dashboard")


@dataclass(frozen=True)
class Cluster:
    """A scheduler and one nanny for two workers, as anybody would start them."""

    address: str
    scheduler: subprocess.Popen[bytes]
    nannies: subprocess.Popen[bytes]

    def workers(self) -> list[psutil.Process]:
        """The worker processes, which the nannies start again when they die."""
        return [member for member in session_members(self.nannies.pid) if "spawn_main" in " ".join(member.cmdline())]

    def simulating(self) -> bool:
        """Whether a worker is at work."""
        return bool(simulations(self.nannies.pid))


@contextmanager
def running(folder: Path) -> Iterator[Cluster]:
    """A cluster that ends with the block; ``folder`` is for its files and for the workers' own cache."""
    environment = {**os.environ, "DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD": "spawn"}
    note = folder / "scheduler.json"
    python = [sys.executable, "-m", "distributed.cli.dask_scheduler"]
    options = {"start_new_session": True, "env": environment, "cwd": ROOT, "stdin": subprocess.DEVNULL}
    log = (folder / "log.txt").open("wb")
    with log:
        scheduler = subprocess.Popen(
            [*python, *LOOPBACK, "--port", "0", "--scheduler-file", str(note)], stdout=log, stderr=log, **options
        )
        nannies = None
        try:
            assert wait_for(lambda: note.is_file() and note.stat().st_size > 0)
            python = [sys.executable, "-m", "distributed.cli.dask_worker", "--scheduler-file", str(note)]
            local = ["--nworkers", "2", "--nthreads", "1", "--local-directory", str(folder)]
            nannies = subprocess.Popen([*python, *LOOPBACK, *local], stdout=log, stderr=log, **options)
            yield Cluster(address_in(note), scheduler, nannies)
        finally:
            for process in (nannies, scheduler):
                if process is not None:
                    end_session(process.pid)
                    process.wait()


def address_in(note: Path) -> str:
    """The address in a scheduler's file."""
    return str(json.loads(note.read_text())["address"])


@pytest.fixture(scope="module")
def dask(tmp_path_factory) -> Iterator[Cluster]:
    """A cluster for the tests that leave it whole."""
    with running(tmp_path_factory.mktemp("cluster")) as found:
        yield found


@pytest.fixture(scope="module")
def local(tmp_path_factory) -> bytes:
    """The table of a run on this machine's own processes."""
    folder = tmp_path_factory.mktemp("local")
    finished(command(folder, *NOISE))
    return (folder / "cases.csv").read_bytes()


def test_results_are_bit_identical_to_a_local_run(dask, local, tmp_path):
    done = finished(command(tmp_path, *NOISE, "--scheduler", dask.address))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "cases.csv").read_bytes() == local
    again = finished(command(tmp_path, *NOISE, "--scheduler", dask.address))
    assert "are there from an earlier run" in again.stderr


def test_a_crash_costs_its_cases_only(dask, tmp_path):
    fmu = build_or_skip(lambda: hostile_fmu(tmp_path, Fault("abort", "step", 0.02)))
    done = finished(command(tmp_path, str(fmu), *NOISE, "--scheduler", dask.address))
    assert done.returncode == 1
    table = (tmp_path / "cases.csv").read_text()
    assert "the process was ended by SIGABRT, in the call 'fmi2DoStep' of the controller at t = 0.02 s" in table
    assert "skipped after 3 failures of one kind" in table
    assert len(dask.workers()) == 2


def test_a_worker_that_is_killed_loses_nothing(dask, local, tmp_path):
    with started(command(tmp_path, *NOISE, "--scheduler", dask.address)) as process:
        assert wait_for(dask.simulating)
        victim = dask.workers()[0]
        kill(victim)
        output, errors = process.communicate(timeout=120)
    assert "Traceback" not in errors
    assert process.returncode == 0, errors
    assert (tmp_path / "cases.csv").read_bytes() == local
    assert wait_for(lambda: len(dask.workers()) == 2)  # the nanny has started another


def test_all_workers_killed_at_once_lose_nothing(dask, local, tmp_path):
    with started(command(tmp_path, *NOISE, "--scheduler", dask.address)) as process:
        assert wait_for(dask.simulating)
        for victim in dask.workers():
            kill(victim)
        errors = process.communicate(timeout=120)[1]
    assert (process.returncode, "Traceback" in errors) == (0, False), errors
    assert (tmp_path / "cases.csv").read_bytes() == local


def test_control_c(dask, local, tmp_path):
    with started(command(tmp_path, *NOISE, "--scheduler", dask.address)) as process:
        assert wait_for(dask.simulating)
        os.killpg(process.pid, signal.SIGINT)
        errors = process.communicate(timeout=60)[1]
        assert (process.returncode, "Traceback" in errors) == (130, False), errors
    assert wait_for(lambda: not dask.simulating())  # a worker finishes the group it is at


def test_what_is_left_when_the_run_is_closed_is_not_run(dask, plant_file, pid_file):
    plant, controller = open_archive(plant_file), open_archive(pid_file)
    jobs = [Job(plant, controller, (number,), print, (60.0,)) for number in range(2000)]
    outcomes = cluster.run(jobs, dask.address)
    assert isinstance(next(outcomes)[1], Finished)
    with distributed.Client(dask.address) as observer:
        assert tasks_of(observer) > 500, "there is more to do than can be done in the time that follows"
        outcomes.close()
        assert wait_for(lambda: tasks_of(observer) == 0, 3.0)
    assert wait_for(lambda: not dask.simulating(), 5.0)


def tasks_of(client) -> int:
    """How many tasks the scheduler knows."""
    return len(client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.tasks)))


def test_what_a_worker_lacks_is_told(plant_file, pid_file, tmp_path, monkeypatch):
    job = Job(open_archive(plant_file), open_archive(pid_file), (1,), print, (60.0,), sandbox=True)
    monkeypatch.setenv("PATH", str(tmp_path))  # no bubblewrap there
    with running(tmp_path) as own, pytest.raises(InputError) as told:
        list(cluster.run([job], own.address))
    assert str(told.value).startswith(f"A worker of the cluster at {own.address} cannot run a job: --sandbox needs")


def test_a_scheduler_that_is_killed(local, tmp_path):
    with running(tmp_path) as own, started(command(tmp_path, *NOISE, "--scheduler", own.address)) as process:
        assert wait_for(own.simulating)
        kill(psutil.Process(own.scheduler.pid))
        errors = process.communicate(timeout=120)[1]
        assert "Traceback" not in errors
        assert process.returncode == 1
        assert "run the same command again" in errors
    finished(command(tmp_path, *NOISE))
    assert (tmp_path / "cases.csv").read_bytes() == local


def test_nobody_answers(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(cluster, "CONNECT_TIME", 0.5)
    arguments = [*NOISE, "--output-dir", str(tmp_path), "--scheduler", "tcp://127.0.0.1:9"]
    assert guarded(evaluate.main, arguments) == EXIT_BAD_INPUT
    assert "error: There is no Dask scheduler at tcp://127.0.0.1:9" in capsys.readouterr().err


@pytest.mark.parametrize("address", ["nonsense", "ftp://127.0.0.1:1", "tcp://127.0.0.1"])
def test_an_address_that_is_none(address, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIME", 0.5)
    with pytest.raises(InputError, match="no Dask scheduler at"):
        list(cluster.run([], address))


def test_dask_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError, match="pip install"):
        list(cluster.run([], "tcp://127.0.0.1:9"))
