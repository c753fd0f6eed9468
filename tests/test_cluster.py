"""A real Dask scheduler with two worker processes on loopback: the same numbers as here, and nothing is ever lost."""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
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
from hostile.runs import bench, job

from orchestrator.codec import Malformed, pack
from orchestrator.errors import EnvironmentFault, InputError
from orchestrator.execution import cluster
from orchestrator.execution.cluster import RemoteAnswer, RemoteDone
from orchestrator.execution.job import Died, Done, Refused
from orchestrator.execution.messages import ErrorRecord
from orchestrator.fmi.trace import Place

distributed = pytest.importorskip("distributed", reason="distributed (Dask) is not installed: pip install distributed")
pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="sessions of POSIX")

LOOPBACK = ("--host", "127.0.0.1", "--no-dashboard")


@dataclass(frozen=True)
class Cluster:
    """A scheduler and one nanny for two workers, as anybody would start them."""

    address: str
    scheduler: subprocess.Popen[bytes]
    nannies: subprocess.Popen[bytes] | None

    def workers(self) -> list[psutil.Process]:
        """The worker processes, which the nannies start again when they die."""
        members = session_members(self.nannies.pid)
        return [each for each in members if "spawn_main" in " ".join(each.cmdline())]

    def simulating(self) -> bool:
        """Whether a worker is at work."""
        return bool(simulations(self.nannies.pid))


@contextmanager
def running(folder: Path, workers: int = 2, path: Path = ROOT) -> Iterator[Cluster]:
    """A cluster that ends with the block; ``folder`` is for its files, ``path`` has the workers' packages."""
    environment = {
        **os.environ,
        "DASK_DISTRIBUTED__WORKER__MULTIPROCESSING_METHOD": "spawn",
        "PYTHONPATH": os.pathsep.join((str(path), str(ROOT / "tests"))),
    }
    note = folder / "scheduler.json"
    with (folder / "log.txt").open("wb") as log:
        options = {"start_new_session": True, "env": environment, "cwd": folder, "stdin": subprocess.DEVNULL}
        options |= {"stdout": log, "stderr": log}
        scheduler = subprocess.Popen(
            [sys.executable, "-m", "distributed.cli.dask_scheduler", *LOOPBACK, "--port", "0"]
            + ["--scheduler-file", str(note)],
            **options,
        )
        nannies = None
        try:
            assert wait_for(lambda: note.is_file() and note.read_text().endswith("}"))
            address = str(json.loads(note.read_text())["address"])
            if workers:
                nannies = subprocess.Popen(
                    [sys.executable, "-m", "distributed.cli.dask_worker", address, *LOOPBACK]
                    + ["--nworkers", str(workers), "--nthreads", "1", "--local-directory", str(folder)],
                    **options,
                )
            yield Cluster(address, scheduler, nannies)
        finally:
            for process in (nannies, scheduler):
                if process is not None:
                    end_session(process.pid)
                    process.wait()


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


@pytest.fixture
def own(plant_file, pid_file):
    """The plant with the default controller."""
    return bench(plant_file, pid_file)


def test_results_are_bit_identical_to_a_local_run(dask, local, tmp_path):
    done = finished(command(tmp_path, *NOISE, "--scheduler", dask.address))
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "cases.csv").read_bytes() == local


def test_a_crash_costs_its_cases_only(dask, tmp_path):
    fmu = build_or_skip(lambda: hostile_fmu(tmp_path, Fault("abort", "step", 0.02)))
    done = finished(command(tmp_path, str(fmu), *NOISE, "--scheduler", dask.address))
    assert done.returncode == 1
    table = (tmp_path / "cases.csv").read_text()
    assert "SIGABRT, in the call 'fmi2DoStep' of the controller at t = 0.02 s" in table
    assert "skipped after 3 failures of one kind" in table
    assert len(dask.workers()) == 2


@pytest.mark.parametrize("count", [1, 2])
def test_workers_that_are_killed_lose_nothing(count, dask, local, tmp_path):
    assert wait_for(lambda: len(dask.workers()) == 2)
    with started(command(tmp_path, *NOISE, "--scheduler", dask.address)) as process:
        assert wait_for(dask.simulating)
        for victim in dask.workers()[:count]:
            kill(victim)
        errors = process.communicate(timeout=120)[1]
    assert (process.returncode, "Traceback" in errors) == (0, False), errors
    assert (tmp_path / "cases.csv").read_bytes() == local


def test_control_c(dask, tmp_path):
    with started(command(tmp_path, *NOISE, "--scheduler", dask.address)) as process:
        assert wait_for(dask.simulating)
        os.killpg(process.pid, signal.SIGINT)
        errors = process.communicate(timeout=60)[1]
        assert (process.returncode, "Traceback" in errors) == (130, False), errors
    assert wait_for(lambda: not dask.simulating())  # a worker finishes the group it is at


def test_what_is_left_when_the_run_is_closed_is_not_run(dask, own):
    outcomes = cluster.run([job(own, "echo", b"x")] * 2000, dask.address)
    assert isinstance(next(outcomes)[1], Done)
    with distributed.Client(dask.address) as observer:
        assert tasks_of(observer) > 500, "there is more to do than can be done in the time that follows"
        outcomes.close()
        assert wait_for(lambda: tasks_of(observer) == 0)


def tasks_of(client) -> int:
    """How many tasks the scheduler knows."""
    return len(client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.tasks)))


def test_a_scheduler_that_is_killed_keeps_what_is_finished(local, tmp_path):
    with running(tmp_path) as own, started(command(tmp_path, *NOISE, "--scheduler", own.address)) as process:
        assert wait_for(own.simulating)
        kill(psutil.Process(own.scheduler.pid))
        errors = process.communicate(timeout=120)[1]
        assert (process.returncode, "Traceback" in errors) == (1, False), errors
    finished(command(tmp_path, *NOISE))
    assert (tmp_path / "cases.csv").read_bytes() == local


# ---- Whom results are taken from ----


def test_workers_with_other_sources_are_refused_before_the_first_job(own, tmp_path):
    clone = tmp_path / "clone"
    for package in ("orchestrator", "controller_fmu", "plant_fmu"):
        shutil.copytree(ROOT / package, clone / package, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "build_fmus.py", clone)
    (clone / "orchestrator" / "loop" / "__init__.py").open("a").write("# edited\n")
    with running(tmp_path, 1, clone) as other, pytest.raises(InputError) as told:
        next(cluster.run([job(own, "echo", b"x")], other.address))
    assert told.value.what == "other-code"
    assert cluster.code_identity() in str(told.value) and told.value.value != cluster.code_identity()


def test_workers_without_the_package_are_refused(own, monkeypatch):
    class Client:
        """Stands for one whose workers cannot import the function they are asked for."""

        answer: object = {"tcp://w": ModuleNotFoundError("No module named 'orchestrator'")}

        def run(self, function, on_error):
            if isinstance(self.answer, Exception):
                raise self.answer
            return self.answer

    with pytest.raises(InputError) as told:
        cluster._check_workers(Client(), "tcp://s")
    assert told.value.what == "other-code"
    Client.answer = OSError("the connection is closed")
    with pytest.raises(EnvironmentFault):
        cluster._check_workers(Client(), "tcp://s")


def test_a_client_with_other_code_is_refused_by_a_worker_that_came_later(own, monkeypatch):
    packed = cluster._packed(job(own, "echo", b"x"))
    monkeypatch.setattr(cluster, "code_identity", lambda: "another")
    with pytest.raises(InputError) as told:
        cluster._outcomes(cluster._run_remotely(packed, b"", b""), job(own, "echo", b"x"))
    assert told.value.what == "other-code"


def test_a_cluster_without_workers_is_an_environment_fault(own, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "WORKER_TIME", 0.1)
    monkeypatch.setattr(cluster, "LOOK", 0.05)
    with running(tmp_path, 0) as empty, pytest.raises(EnvironmentFault) as told:
        next(cluster.run([job(own, "echo", b"x")], empty.address))
    assert told.value.what == "no-worker"


def test_an_fmu_that_is_not_the_one_announced_is_refused(own):
    content = own.controller.content
    answer = cluster._run_remotely(cluster._packed(job(own, "echo", b"x")), content, content)
    with pytest.raises(InputError) as told:
        cluster._outcomes(answer, job(own, "echo", b"x"))
    assert told.value.what == "changed"


DONE = RemoteDone(0, b"x", 0.5)
DIED = Died(0, False, "it died", "", 1.0, Place(3, 2, "step"), ("last words",), True)
REFUSED = Refused(0, ErrorRecord("fmu", "it failed"), 0.1)


def test_outcomes_arrive(own):
    two = job(own, "echo", b"x", b"y")
    for sent in (Done(0, b"x", 0.5), DIED, REFUSED):
        answer = pack(RemoteAnswer((cluster._as_sent(sent), cluster._as_sent(Done(1, b"y", 0.5)))))
        assert cluster._outcomes(answer, two) == [sent, Done(1, b"y", 0.5)]


@pytest.mark.parametrize(
    "answer",
    [
        None,
        "text",
        b"",
        pack(RemoteAnswer()),
        *(
            pack(RemoteAnswer((outcome,)))
            for outcome in (
                (None, None, None),
                (DONE, REFUSED, None),
                (RemoteDone(1, b"x", 0.5), None, None),
                (RemoteDone(0, b"x", float("nan")), None, None),
                (RemoteDone(0, b"x", -1.0), None, None),
                (None, None, replace(DIED, wall_time=float("inf"))),
                (None, None, replace(DIED, index=-1)),
            )
        ),
    ],
    ids=str,
)
def test_what_a_worker_sends_is_checked(answer, own):
    with pytest.raises(Malformed):
        cluster._outcomes(answer, job(own, "echo", b"x"))


# ---- Who is asked ----


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nonsense", "ftp://127.0.0.1:1", "tcp://127.0.0.1"])
def test_an_address_where_nobody_answers(address, monkeypatch):
    monkeypatch.setattr(cluster, "CONNECT_TIME", 0.5)
    with pytest.raises(InputError) as told:
        list(cluster.run([], address))
    assert (told.value.what, told.value.where) == ("no-scheduler", address)


def test_dask_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(InputError) as told:
        list(cluster.run([], "tcp://127.0.0.1:9"))
    assert told.value.what == "no-dask"
