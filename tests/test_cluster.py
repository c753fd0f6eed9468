"""A real Dask scheduler with two worker processes on loopback: the same numbers as here, and nothing is ever lost."""

import json
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from hostile.commands import (
    NOISE,
    ROOT,
    command,
    command_line,
    end_session,
    kill,
    session_members,
    simulations,
    started,
    stored,
    wait_for,
)
from hostile.fmus import Fault, hostile_fmu
from hostile.runs import copied_packages, job
from msgspec.structs import replace
from support.refusals import refusal
from support.tools import require

from orchestrator import Benchmark, Controller
from orchestrator.codec import Malformed, pack
from orchestrator.errors import EnvironmentFault
from orchestrator.execution import cluster
from orchestrator.execution.cluster import RemoteAnswer
from orchestrator.execution.job import Died, Done
from orchestrator.execution.messages import ErrorRecord, Failed, Finished
from orchestrator.fmi.trace import Place
from orchestrator.loop.trajectory import Status

pytestmark = pytest.mark.needs("posix", "distributed")

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
        return [each for each in members if "spawn_main" in command_line(each)]

    def simulating(self) -> bool:
        """Whether a worker is at work."""
        return bool(simulations(self.nannies.pid))


@contextmanager
def running(folder: Path, workers: int = 2, path: Path = ROOT, *more: str) -> Iterator[Cluster]:
    """A cluster that ends with the block; ``folder`` is for its files, ``path`` has the workers' packages, ``more`` are
    options of both commands."""
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
            [sys.executable, "-m", "distributed.cli.dask_scheduler", *LOOPBACK, *more, "--port", "0"]
            + ["--scheduler-file", str(note)],
            **options,
        )
        nannies = None
        try:
            assert wait_for(lambda: note.is_file() and note.read_text().endswith("}"))
            address = str(json.loads(note.read_text())["address"])
            if workers:
                nannies = subprocess.Popen(
                    [sys.executable, "-m", "distributed.cli.dask_worker", address, *LOOPBACK, *more]
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
def local(undisturbed) -> bytes:
    """The table of a run on this machine's own processes."""
    return (undisturbed / "cases.csv").read_bytes()


def evaluated(address, folder, file=None):
    """The evaluation of a controller on a cluster."""
    return Benchmark(scheduler=address).evaluate(Controller(file), only=NOISE[1], folder=folder, recordings=False)


def test_a_crash_costs_its_cases_only(dask, tmp_path):
    fmu = hostile_fmu(tmp_path, Fault("abort", "step", 0.02))
    cases = evaluated(dask.address, tmp_path / "out", fmu).cases
    crashed, skipped = ([case for case in cases if case.status is of] for of in (Status.CRASHED, Status.SKIPPED))
    assert len(crashed) >= 3 and skipped and len(crashed) + len(skipped) == len(cases)
    assert {case.time for case in crashed} == {0.02} and len(dask.workers()) == 2


def test_workers_that_are_killed_lose_nothing(dask, local, tmp_path):
    """Nor does a cluster give other numbers."""
    assert wait_for(lambda: len(dask.workers()) == 2)
    with started(command(tmp_path, *NOISE, "--scheduler", dask.address)) as process:
        assert wait_for(dask.simulating)
        for victim in dask.workers():
            kill(victim)
        errors = process.communicate()[1]
    assert (process.returncode, "Traceback" in errors) == (0, False), errors
    assert (tmp_path / "cases.csv").read_bytes() == local


def test_what_is_left_when_the_run_is_closed_is_not_run(dask, own):
    import distributed

    outcomes = cluster.run([job(own, "echo", b"x")] * 400, dask.address)
    assert isinstance(next(outcomes)[1], Done)
    with distributed.Client(dask.address) as observer:
        assert tasks_of(observer) > 100, "there is more to do than can be done in the time that follows"
        outcomes.close()
        assert wait_for(lambda: tasks_of(observer) == 0)


def tasks_of(client) -> int:
    """How many tasks the scheduler knows."""
    return len(client.run_on_scheduler(lambda dask_scheduler: list(dask_scheduler.tasks)))


def test_a_scheduler_that_is_killed_keeps_what_is_finished(local, tmp_path):
    with running(tmp_path) as own, started(command(tmp_path, *NOISE, "--scheduler", own.address)) as process:
        assert wait_for(own.simulating)
        kill(psutil.Process(own.scheduler.pid))
        errors = process.communicate()[1]
        assert (process.returncode, "Traceback" in errors) == (1, False), errors
    evaluated(None, tmp_path)
    assert (tmp_path / "cases.csv").read_bytes() == local


def test_a_scheduler_that_freezes_is_given_up_and_what_is_finished_is_kept(tmp_path):
    options = ("--only", "*.noise", "--wait", "8", "--scheduler")
    with running(tmp_path) as own, started(command(tmp_path, *options, own.address)) as process:
        assert wait_for(lambda: stored(tmp_path) > 0)
        own.scheduler.send_signal(signal.SIGSTOP)
        errors = process.communicate()[1]
        assert process.returncode == 1 and "no answer within 8 s" in errors and "Traceback" not in errors, errors
    assert stored(tmp_path) > 0


@pytest.fixture
def certificate(tmp_path) -> Path:
    """A self-signed one with its key in the same file."""
    require("openssl")
    file = tmp_path / "own.pem"
    words = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-subj", "/CN=loopback", "-days", "1"]
    subprocess.run([*words, "-keyout", file, "-out", tmp_path / "alone.pem"], check=True, capture_output=True)
    file.write_bytes(file.read_bytes() + (tmp_path / "alone.pem").read_bytes())
    return file


def test_a_run_over_tls(local, certificate, tmp_path):
    tls = [word for name in ("ca-file", "cert", "key") for word in (f"--tls-{name}", str(certificate))]
    names = ("CA_FILE", "CLIENT__CERT", "CLIENT__KEY")
    environment = {f"DASK_DISTRIBUTED__COMM__TLS__{name}": str(certificate) for name in names}
    with running(tmp_path, 2, ROOT, *tls, "--protocol", "tls") as own:
        assert own.address.startswith("tls://")
        words = command(tmp_path, *NOISE, "--scheduler", own.address)
        with started(words, environment=environment) as process:
            errors = process.communicate()[1]
        assert process.returncode == 0, errors
        assert (tmp_path / "cases.csv").read_bytes() == local
        assert refusal(list, cluster.run([], own.address, 5.0)).what == "no-scheduler", "without certificates"


@pytest.mark.parametrize(
    ("file", "what"),
    [("orchestrator/loop/__init__.py", "other-code"), ("plant_fmu/manipulator_fmu.py", "other-plant")],
)
def test_workers_with_other_sources_are_refused_before_the_first_job(file, what, own, tmp_path):
    clone = copied_packages(tmp_path / "clone")
    (clone / file).open("a").write("# edited\n")
    with running(tmp_path, 1, clone) as other:
        error = refusal(next, cluster.run([job(own, "echo", b"x")], other.address))
    assert error.what == what and error.where.startswith("The worker tcp://")


def test_workers_without_the_package_are_refused(own):
    class Client:
        """Stands for one whose workers cannot import the function they are asked for."""

        answer: object = {"tcp://w": ModuleNotFoundError("No module named 'orchestrator'")}

        def run(self, function, on_error):
            if isinstance(self.answer, Exception):
                raise self.answer
            return self.answer

    assert refusal(cluster._check_workers, Client(), "tcp://s", 1.0).what == "other-version"
    Client.answer = OSError("the connection is closed")
    refusal(cluster._check_workers, Client(), "tcp://s", 1.0, kind=EnvironmentFault)


def test_a_worker_refuses_other_code_and_another_fmu_than_announced(own, monkeypatch):
    given, content = job(own, "echo", b"x"), own.controller.content
    packed = cluster._packed(given)
    assert refusal(cluster._outcomes, cluster._run_remotely(packed, content, content), given).what == "changed"
    other = replace(cluster.identity(), platform="another")
    monkeypatch.setattr(cluster, "identity", lambda: other)
    assert refusal(cluster._outcomes, cluster._run_remotely(packed, b"", b""), given).what == "other-platform"


def test_a_cluster_without_workers_is_an_environment_fault(own, tmp_path, monkeypatch):
    monkeypatch.setattr(cluster, "POLL_INTERVAL", 0.05)
    with running(tmp_path, 0) as empty:
        outcomes = cluster.run([job(own, "echo", b"x")], empty.address, 5.0)
        assert refusal(next, outcomes, kind=EnvironmentFault).what == "no-worker"


DONE = Finished(0, b"x", 0.5)
DIED = Died(0, False, "it died", "", 1.0, Place(3, 2, "step"), ("last words",), True)
REFUSED = Failed(0, ErrorRecord("fmu", "it failed"), 0.1)


def test_outcomes_arrive(own):
    two = job(own, "echo", b"x", b"y")
    for sent, found in ((DONE, Done(0, b"x", 0.5)), (DIED, DIED), (REFUSED, REFUSED)):
        answer = pack(RemoteAnswer((sent, Finished(1, b"y", 0.5))))
        assert cluster._outcomes(answer, two) == [found, Done(1, b"y", 0.5)]


WRONG = (
    (DONE, REFUSED),
    (Finished(1, b"x", 0.5),),
    (Finished(0, b"x", float("nan")),),
    (Finished(0, b"x", -1.0),),
    (replace(DIED, wall_time=float("inf")),),
    (replace(DIED, index=-1),),
)


@pytest.mark.parametrize(
    "answer", [None, "text", b"", pack(RemoteAnswer()), *(pack(RemoteAnswer(each)) for each in WRONG)], ids=str
)
def test_what_a_worker_sends_is_checked(answer, own):
    refusal(cluster._outcomes, answer, job(own, "echo", b"x"), kind=Malformed)


@pytest.mark.parametrize(
    "address", ["tcp://127.0.0.1:9", "tls://127.0.0.1:9", "nonsense", "ftp://127.0.0.1:1", "tcp://127.0.0.1"]
)
def test_an_address_where_nobody_answers(address):
    error = refusal(list, cluster.run([], address, 0.5))
    assert (error.what, error.where) == ("no-scheduler", address)


def test_a_server_that_says_nothing_is_given_up():
    with socket.create_server(("127.0.0.1", 0)) as silent:
        address = f"tcp://127.0.0.1:{silent.getsockname()[1]}"
        error = refusal(list, cluster.run([], address, 0.5))
    assert error.what == "no-scheduler" and "no answer within 0.5 s" in str(error)


def test_workers_that_say_nothing_are_given_up():
    class Client:
        def run(self, function, on_error):
            threading.Event().wait(30.0)

    assert "within 0.2 s" in str(refusal(cluster._check_workers, Client(), "tcp://s", 0.2, kind=EnvironmentFault))


def test_what_a_worker_says_of_itself_is_checked():
    answers = [b"", pack({"version": "1"}), pack(cluster.identity())[:-1], {"version": "1"}]
    for answer in answers:
        client = SimpleNamespace(run=lambda *_, answer=answer, **__: {"tcp://w": answer})
        assert refusal(cluster._check_workers, client, "tcp://s", 1.0).what == "other-version"


def test_dask_is_not_installed(monkeypatch):
    monkeypatch.setitem(sys.modules, "distributed", None)
    assert refusal(list, cluster.run([], "tcp://127.0.0.1:9")).what == "no-dask"
