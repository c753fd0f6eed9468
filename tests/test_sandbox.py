"""In the sandbox a controller reaches neither the network nor the user's files, and gives the same numbers."""

from __future__ import annotations

import os
import shutil
import stat
import subprocess
import sys
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import psutil
import pytest
from hostile import fmus
from hostile.commands import command, finished
from hostile.runs import STRUCK, bench, run, short_cases

from orchestrator.cosim.trajectory import Status
from orchestrator.errors import InputError
from orchestrator.execution import evaluation, launch
from orchestrator.execution.evaluation import simulate_isolated
from orchestrator.execution.isolation import run_isolated
from orchestrator.execution.job import Finished, Job


def problem() -> str:
    """Why there is no sandbox here; empty where there is one."""
    program = shutil.which("bwrap")
    if program is None:
        return "bubblewrap is not installed"
    tried = subprocess.run([program, *launch.SANDBOX, "--", "true"], capture_output=True, text=True, check=False)
    return "" if tried.returncode == 0 else f"bubblewrap may not work here: {tried.stderr.strip()}"


REPORT = 6
PROBLEM = problem()
sandboxed = pytest.mark.skipif(bool(PROBLEM), reason=PROBLEM or "-")


@pytest.fixture(scope="module")
def slave(fmu_folder) -> Path:
    """The FMU of ``tests/hostile/slave.py``."""
    return fmus.python_fmu(fmu_folder)


def with_fault(own, fault: int, **changes):
    """The bench whose controller has this fault."""
    return replace(own, setup=replace(own.setup, parameters={"fault": float(fault)}), **changes)


@sandboxed
def test_the_sandbox_stops_what_is_allowed_without_it(plant_file, slave, tmp_path, monkeypatch):
    """The controller connects to a server on this machine, reads where it may, and writes into the user's home."""
    monkeypatch.setenv("HOME", str(tmp_path))
    own = bench(plant_file, slave, limit=120.0)
    (case,) = short_cases(own.plant, (STRUCK,))
    reports = {}
    for sandbox in (False, True):
        (result,) = run(with_fault(own, REPORT, sandbox=sandbox), [case])
        assert result.status is Status.ERROR
        reports[sandbox] = result.message
    assert "home: written" in reports[False]
    assert "own folder: written" in reports[False]
    assert "home: refused" in reports[True]
    assert "network: refused" in reports[True]
    assert "processes: 3 or fewer" in reports[True]
    assert "temporary files: written" in reports[True]


@sandboxed
def test_the_numbers_are_the_same(plant_file, pid_file):
    own = bench(plant_file, pid_file, limit=120.0)
    scenario = short_cases(own.plant, (STRUCK,))[0].scenario
    free, boxed = (simulate_isolated(scenario, replace(own, sandbox=sandbox)) for sandbox in (False, True))
    assert free.torque.tobytes() == boxed.torque.tobytes()
    assert free.X.tobytes() == boxed.X.tobytes()


@sandboxed
def test_what_python_needs_of_the_hidden_folder_is_there(plant_file, pid_file, tmp_path, monkeypatch):
    """The sandbox has a /tmp of its own; a package that lies in the outer one is found all the same."""
    (tmp_path / "lies_in_tmp.py").write_text("def work(plant, controller, task):\n    return task + 1\n")
    assert str(tmp_path).startswith("/tmp/") or sys.platform != "linux"
    monkeypatch.syspath_prepend(str(tmp_path))
    own = bench(plant_file, pid_file, limit=120.0)
    job = Job(own.plant, own.controller, (41,), import_module("lies_in_tmp").work, (120.0,), sandbox=True)
    (outcome,) = run_isolated(job)
    assert isinstance(outcome, Finished), outcome
    assert outcome.value == 42


@sandboxed
def test_crashes_hangs_and_processes_left_behind(plant_file, slave, monkeypatch):
    monkeypatch.setattr(evaluation, "START_TIME", 60.0)
    own = bench(plant_file, slave, sandbox=True)
    before = sleepers()
    cases = short_cases(own.plant, (STRUCK,))
    (crashed,) = run(with_fault(own, 2), cases)
    assert (crashed.status, crashed.time) == (Status.CRASHED, 0.0)
    assert "exit code 7" in crashed.message
    (left,) = run(with_fault(own, 4), cases)
    assert left.status is Status.DONE
    _, alive = psutil.wait_procs(sleepers() - before, timeout=5)  # the system ends a sandbox in its own time
    assert not alive


def sleepers() -> set[psutil.Process]:
    """What the hostile controller starts; it would sleep for minutes."""
    return {process for process in psutil.process_iter() if process.name() == "sleep"}


@sandboxed
def test_as_a_command(tmp_path):
    tables = {}
    for option in ((), ("--sandbox",)):
        folder = tmp_path / "-".join(("out", *option))
        done = finished(command(folder, "--only", "c00.compliant.noise", *option))
        assert done.returncode == 0, done.stderr
        tables[option] = (folder / "cases.csv").read_bytes()
    assert tables[()] == tables[("--sandbox",)]


def test_without_bubblewrap_the_option_is_refused(plant_file, slave, monkeypatch):
    monkeypatch.setenv("PATH", "/nonexistent")
    own = bench(plant_file, slave, sandbox=True)
    with pytest.raises(InputError, match="--sandbox needs bubblewrap"):
        run(own, short_cases(own.plant, (STRUCK,)))


@pytest.mark.skipif(sys.platform != "linux", reason="a shell script stands for bubblewrap")
def test_where_bubblewrap_may_not_work_the_option_is_refused(plant_file, slave, tmp_path, monkeypatch):
    program = tmp_path / "bwrap"
    program.write_text("#!/bin/sh\necho 'bwrap: No permissions to create new namespace' >&2\nexit 1\n")
    program.chmod(program.stat().st_mode | stat.S_IXUSR)
    monkeypatch.setenv("PATH", f"{tmp_path}{os.pathsep}{os.environ['PATH']}")
    own = bench(plant_file, slave, sandbox=True)
    with pytest.raises(InputError, match="No permissions to create new namespace"):
        run(own, short_cases(own.plant, (STRUCK,)))
