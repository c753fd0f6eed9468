"""Child processes: how they start, what their parent never does, and that none stays behind."""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest
from hostile import fmus
from hostile.commands import command, finished
from hostile.fmus import Fault
from hostile.runs import STRUCK, bench, run, short_cases

from orchestrator.execution import evaluation, pool
from orchestrator.execution.evaluation import rehearse
from orchestrator.execution.job import Finished, Job

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the corpus is written for Linux")


# ---- The start of a child ----

REPORTING = """
import sys

def work(plant, controller, task):
    main = sys.modules.get("__mp_main__")
    return getattr(getattr(main, "__spec__", None), "name", ""), "orchestrator.evaluate" in sys.modules
"""


def test_a_child_does_not_import_the_command(plant_file, faulty, tmp_path, monkeypatch):
    (tmp_path / "reporting.py").write_text(REPORTING)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", find_spec("orchestrator.evaluate"))
    main = sys.modules["__main__"]
    own = bench(plant_file, faulty(fmus.NONE))
    jobs = [Job(own.plant, own.controller, (0,), import_module("reporting").work, (60.0,)) for _ in range(6)]
    for _, outcome in pool.run(jobs, workers=3):
        assert isinstance(outcome, Finished), outcome
        assert outcome.value[0] != "orchestrator.evaluate"
        assert not outcome.value[1]
    assert sys.modules["__main__"] is main


def test_work_of_a_script_of_ones_own_is_found(plant_file, faulty, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"""
from orchestrator.cosim.archive import open_archive
from orchestrator.execution.isolation import run_isolated
from orchestrator.execution.job import Job
from pathlib import Path

def work(plant, controller, task):
    return task + 1

if __name__ == "__main__":
    plant, controller = (open_archive(Path(file)) for file in {(str(plant_file), str(faulty(fmus.NONE)))!r})
    print(next(run_isolated(Job(plant, controller, (41,), work, (60.0,)))).value)
""")
    assert finished([sys.executable, str(script)]).stdout == "42\n"


def test_a_folder_of_temporary_files_with_a_long_path(tmp_path):
    folder = tmp_path / ("x" * 100)
    folder.mkdir()
    refused = finished(command(tmp_path / "out", "--quick"), environment={"TMPDIR": str(folder)})
    assert refused.returncode == 2
    assert (
        f"error: No child process can be started: AF_UNIX path too long. It needs a socket in {folder}: set TMPDIR"
        in refused.stderr
    )


# ---- The parent ----


def test_the_parent_never_loads_an_fmu(plant_file, faulty):
    """It may build and unpack, but no library of an FMU is mapped into it."""
    own = bench(plant_file, faulty(fmus.NONE))
    run(own, short_cases(own.plant, (STRUCK,)))
    mapped = Path("/proc/self/maps").read_text()
    assert "/fmus/" not in mapped


def test_no_descriptor_or_child_stays_after_many_faults(plant_file, faulty):
    benches = [bench(plant_file, faulty(Fault(what)), limit=20.0) for what in ("abort", "exit:0", "status:3")]
    cases = short_cases(benches[0].plant, (STRUCK,) * 3)
    run(benches[0], cases)
    before = descriptors()
    for own in benches:
        run(own, cases, workers=2)
    assert descriptors() <= before
    assert children_of_fork_server() == []


def descriptors() -> int:
    """Open files of this process."""
    return len(os.listdir("/proc/self/fd"))


def children_of_fork_server() -> list[psutil.Process]:
    """Simulations that are still running below this process."""
    servers = [child for child in psutil.Process().children() if "forkserver" in " ".join(child.cmdline())]
    return [child for server in servers for child in server.children()]


def test_time_limits_follow_the_simulated_time(plant_file, faulty, monkeypatch):
    monkeypatch.setattr(evaluation, "START_TIME", 5.0)
    own = replace(bench(plant_file, faulty(fmus.NONE)), timeout=52.0)
    scenarios = [case.scenario for case in short_cases(own.plant, (Fraction(13), Fraction(26)))]
    assert own.job(scenarios, scenarios, rehearse, 5.0).time_limits == (5.0 + 26.0, 5.0 + 52.0)
