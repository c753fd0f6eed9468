"""Whatever a controller does costs its own case a status: a corpus of hostile FMUs, each run before a healthy case."""

from __future__ import annotations

import csv
import os
import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from fractions import Fraction
from importlib import import_module
from importlib.util import find_spec
from pathlib import Path

import psutil
import pytest
from conftest import build_or_skip
from hostile import fmus
from hostile.commands import command, finished
from hostile.fmus import Fault, hostile_fmu
from hostile.runs import PROTOCOL, SPARED, STRUCK, bench, run, short_cases

from orchestrator.benchmark.metrics import CaseResult
from orchestrator.cosim.trace import CONTROLLER, Place
from orchestrator.cosim.trajectory import Status
from orchestrator.errors import FmuError
from orchestrator.execution import cluster, evaluation, isolation, pool
from orchestrator.execution.evaluation import Bench, rehearse
from orchestrator.execution.job import Died, Failed, Finished, Job, Limits

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="the corpus is written for Linux")

CRASHED, TIMEOUT, ERROR, DONE = Status.CRASHED, Status.TIMEOUT, Status.ERROR, Status.DONE
ONLY_STRUCK = -float(STRUCK) * 1e3
HANG_LIMIT = 1.2
"""Wall time [s] for a case that hangs; all others have plenty."""


@dataclass(frozen=True)
class Expected:
    """The result of the struck case: status, simulated time [s], and words of its message."""

    fault: Fault
    status: Status
    time: float = 0.02
    words: tuple[str, ...] = ()
    limits: Limits = Limits()

    def __str__(self) -> str:
        return str(self.fault)


def crash(what: str, *words: str, where: str = "step", call: str = "'fmi2DoStep'") -> Expected:
    """A fault that ends the process."""
    time = 0.02 if where in ("step", "set", "get") else 0.0
    return Expected(Fault(what, where, time, ONLY_STRUCK), CRASHED, time, (*words, f"in the call {call} of the contr"))


def hang(what: str, *words: str, where: str = "step", call: str = "'fmi2DoStep'") -> Expected:
    """A fault after which nothing comes any more."""
    time = 0.02 if where == "step" else 0.0
    words = (*words, "the time limit was reached", call)
    return Expected(Fault(what, where, time, ONLY_STRUCK), TIMEOUT, time, words)


def error(what: str, *words: str, where: str = "step", time: float = 0.02) -> Expected:
    """A fault that the master notices."""
    return Expected(Fault(what, where, min(time, 0.02), ONLY_STRUCK), ERROR, time, words)


def harmless(what: str, where: str = "step") -> Expected:
    """What a controller had better not do, but may."""
    return Expected(Fault(what, where, 0.0, ONLY_STRUCK), DONE, float(STRUCK))


CRASHES = [
    crash("segfault", "SIGSEGV", "about to follow a bad pointer"),
    crash("segfault", "SIGSEGV", where="initialize", call="'enterInitializationMode'"),
    crash("segfault", "SIGSEGV", where="get", call="'fmi2GetReal'"),
    crash("overflow", "SIGSEGV"),
    crash("divide", "SIGFPE"),
    crash("abort", "SIGABRT"),
    crash("exit:0", "exit code 0"),
    crash("_exit:3", "exit code 3"),
    crash("exit:139", "exit code 139"),
    crash("thread-crash", "SIGABRT"),
    crash("format", "SIGSEGV"),
    crash("kill:9", "SIGKILL"),
    crash("kill:15", "SIGTERM"),
    crash("garbage", "wrote into a pipe that is not its own"),
    crash("pickle", "wrote into a pipe that is not its own"),
    crash("daemon-crash", "SIGABRT"),
    crash("kill-parent", "exit code 255"),
]
HANGS = [
    hang("spin"),
    hang("spin", where="initialize", call="'enterInitializationMode'"),
    hang("pause"),
    hang("ignore-alarm"),
    hang("stop-timer"),
    hang("block-signals"),
    hang("handlers"),
    hang("stop"),
    hang("log:0"),
    hang("close-all"),
]
ERRORS = [
    error("status:2", "fmi2DoStep returned discard", "as you wish"),
    error("status:3", "fmi2DoStep returned error", "as you wish"),
    error("status:4", "fmi2DoStep returned fatal"),
    error("status:5", "fmi2DoStep returned pending"),
    error("status:77", "illegal status 77"),
    error("status:-1", "illegal status -1"),
    error("status:3", "fmi2SetReal returned error", where="set", time=0.02025),
    error("status:3", "fmi2GetReal returned error", where="get"),
    error("status:3", "enterInitializationMode failed", where="initialize", time=0.0),
    error("value:nan", "no number", where="get"),
    error("value:inf", "no number", where="get"),
    error("value:-inf", "no number", where="get"),
    error("value:1e300", "no number or beyond", where="get"),
    error("utf8", "fmi2DoStep returned error", "caf�"),
    error("percent", "100 %s of %n and %d%%"),
    error("null-message", "fmi2DoStep returned error"),
    error("huge-message", "xxxxxxxx"),
]
HARMLESS = [
    harmless("round"),
    harmless("trap"),
    harmless("chdir"),
    harmless("umask"),
    harmless("close-output"),
    harmless("thread"),
]
FLOODS = [
    replace(crash("grow", "of memory; the limit is 0.4 GB"), limits=Limits(memory=400_000_000)),
    replace(crash("log:1", "logged more than 1 MB", "still here, and talking"), limits=Limits(output=1_000_000)),
    replace(crash("print", "printed or logged more than 1 MB", "no news"), limits=Limits(output=1_000_000)),
]


@pytest.fixture(autouse=True)
def no_slack(monkeypatch):
    """Time limits in proportion to the simulated time alone, and what comes on top of them short."""
    monkeypatch.setattr(evaluation, "START_TIME", 0.0)
    monkeypatch.setattr(isolation, "GRACE", 0.3)


@pytest.fixture(scope="module")
def fmu(fmu_folder):
    """A function that builds the controller with a fault."""
    return lambda fault: build_or_skip(lambda: hostile_fmu(fmu_folder, fault))


@pytest.fixture(scope="module")
def healthy(plant_file, fmu) -> list[CaseResult]:
    """The results of the two cases with a controller without a fault."""
    own = bench(plant_file, fmu(fmus.NONE), limit=120.0)
    results = run(own, short_cases(own.plant, (STRUCK, SPARED)))
    assert [result.status for result in results] == [DONE, DONE]
    return results


@pytest.mark.parametrize("expected", [*CRASHES, *HANGS, *ERRORS, *HARMLESS, *FLOODS], ids=str)
def test_a_hostile_controller_costs_its_own_case_only(expected, plant_file, fmu, healthy):
    limit = HANG_LIMIT if expected.status is TIMEOUT else 10.0
    own = bench(plant_file, fmu(expected.fault), limit, limits=expected.limits)
    struck, spared = run(own, short_cases(own.plant, (STRUCK, SPARED)))
    assert struck.status is expected.status, struck
    assert struck.time == pytest.approx(expected.time, abs=1e-9)
    for word in expected.words:
        assert word in struck.message
    assert "Traceback" not in struck.message
    assert spared.status is DONE
    assert spared.time == float(SPARED)
    assert spared.measurement == healthy[1].measurement  # bit for bit: no fault leaks into another case
    if expected.status is DONE and expected.fault.what != "round":
        assert struck.measurement == healthy[0].measurement


def test_a_warning_is_counted(plant_file, fmu):
    own = bench(plant_file, fmu(Fault("status:1", "step", 0.02)))
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert (result.status, result.warnings) == (DONE, 120)


@pytest.mark.parametrize("what", ["segfault", "exit:0", "spin", "status:3"])
def test_a_controller_that_cannot_be_instantiated(what, plant_file, fmu):
    own = bench(plant_file, fmu(Fault(what, "instantiate", 0.0)), HANG_LIMIT)
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert result.status is {"spin": TIMEOUT, "status:3": ERROR}.get(what, CRASHED)
    assert result.time == 0.0
    assert "instantiation" in result.message


def test_a_crash_in_the_second_instance_goes_away_in_a_process_of_its_own(plant_file, fmu, healthy):
    """Some FMUs can be instantiated once a process. The result of a case must not depend on the ones before it."""
    own = bench(plant_file, fmu(Fault("segfault", "initialize", 0.0, which=2)))
    results = run(own, short_cases(own.plant, (STRUCK, SPARED, STRUCK)))
    assert [result.status for result in results] == [DONE] * 3
    assert results[1].measurement == healthy[1].measurement


def test_a_case_whose_process_is_killed_from_outside_is_run_again(plant_file, fmu, healthy, monkeypatch):
    started, kills = isolation.started, []

    @contextmanager
    def killed_once(job):
        with started(job) as child:
            if not kills:
                kills.append(child.process.kill())
            yield child

    monkeypatch.setattr(isolation, "started", killed_once)
    own = bench(plant_file, fmu(fmus.NONE))
    results = run(own, short_cases(own.plant, (STRUCK, SPARED)))
    assert len(kills) == 1
    assert [result.measurement for result in results] == [result.measurement for result in healthy]


@pytest.mark.parametrize("what", ["daemon", "daemon-session", "daemon-crash"])
def test_no_process_stays_behind(what, plant_file, fmu):
    own = bench(plant_file, fmu(Fault(what, "terminate" if what != "daemon-crash" else "step", 0.0)))
    note = own.controller.folder / "resources" / "daemon.pid"
    note.unlink(missing_ok=True)
    run(own, short_cases(own.plant, (STRUCK,)))
    daemon = int(note.read_text())
    assert ends(daemon), "the process that the FMU has started outlives it"


def ends(pid: int, patience: float = 3.0) -> bool:
    """Whether a process is gone, or going."""
    deadline = time.monotonic() + patience
    while time.monotonic() < deadline:
        try:
            if psutil.Process(pid).status() == psutil.STATUS_ZOMBIE:
                return True
        except psutil.NoSuchProcess:
            return True
        time.sleep(0.05)
    return False


def test_what_an_fmu_writes_over_itself_is_mended(plant_file, fmu, healthy):
    file = fmu(Fault("spoil", "terminate", 0.0))
    for _ in range(2):
        own = bench(plant_file, file)
        (result,) = run(own, short_cases(own.plant, (STRUCK,)))
        assert result.measurement == healthy[0].measurement
    assert (own.controller.folder / "resources" / "fault.txt").read_text().startswith("abort")


# ---- Python FMUs ----


@pytest.fixture(scope="module")
def python_slave(fmu_folder) -> Path:
    """The FMU of ``tests/hostile/slave.py``."""
    return fmus.python_fmu(fmu_folder)


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [
        (1, ERROR, ("fmi2DoStep returned", "the slave has lost its mind")),
        (2, CRASHED, ("exit code 7", "in the call 'fmi2DoStep' of the controller")),
        (3, ERROR, ("fmi2DoStep returned",)),
        (5, ERROR, ("fmi2DoStep returned", "recursion")),
    ],
    ids=["raise", "os._exit", "sys.exit", "recursion"],
)
def test_a_hostile_python_controller(fault, status, words, plant_file, python_slave):
    own = bench(plant_file, python_slave)
    own = replace(own, setup=replace(own.setup, parameters={"fault": float(fault), "at": 0.02}))
    results = run(own, short_cases(own.plant, (STRUCK, STRUCK)))
    for result in results:
        assert (result.status, result.time) == (status, 0.02)
        for word in words:
            assert word in result.message


def test_a_python_controller_that_starts_a_process(plant_file, python_slave):
    own = bench(plant_file, python_slave)
    own = replace(own, setup=replace(own.setup, parameters={"fault": 4.0, "at": 0.02}))
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert result.status is DONE
    assert ends(int((own.controller.folder / "resources" / "daemon.pid").read_text()))


# ---- Three strikes ----


def test_a_broken_controller_answers_after_three_crashes(plant_file, fmu):
    own = bench(plant_file, fmu(Fault("abort")))
    cases = short_cases(own.plant, (STRUCK,) * 4 + (SPARED,) * 4)
    results = run(own, cases, keep_going=False)
    assert [result.status for result in results] == [CRASHED] * 3 + [Status.SKIPPED] * 5
    assert "skipped after 3 failures of one kind (crashed: the process was ended by SIGABRT" in results[3].message
    assert "--keep-going" in results[3].message
    assert [result.status for result in run(own, cases)] == [CRASHED] * 8


def test_the_command_tells_how_it_failed_and_goes_on(fmu, tmp_path):
    file = fmu(Fault("abort"))
    done = finished(command(tmp_path, str(file), "--quick"))
    assert done.returncode == 1
    with (tmp_path / "cases.csv").open() as table:
        rows = list(csv.DictReader(table))
    assert [row["status"] for row in rows].count("skipped") >= 24 - 3 - 2  # two processes may be at work at the third
    crashed = [row for row in rows if row["status"] == "crashed"]
    assert len(crashed) >= 3
    for row in crashed:
        assert row["time [s]"] == "0.02"
        assert "SIGABRT, in the call 'fmi2DoStep' of the controller at t = 0.02 s" in row["message"]


def test_strikes_of_an_earlier_run_count(plant_file, fmu):
    own = bench(plant_file, fmu(Fault("abort")))
    cases = short_cases(own.plant, (STRUCK,) * 4)
    earlier = run(own, cases[:3])

    def never(jobs):
        raise AssertionError("nothing is to be run")

    found = list(evaluation.evaluate(PROTOCOL, cases[3:], own, never, earlier))
    assert [result.status for result in found] == [Status.SKIPPED]


KIND = {
    "grow": ("it used too much memory", Limits(memory=400_000_000)),
    "print": ("it printed or logged too much", Limits(output=1_000_000)),
    "garbage": ("it wrote into a pipe that is not its own", Limits()),
    "exit:3": ("the process ended by itself with exit code 3", Limits()),
    "spin": ("the time limit was reached", Limits()),
}


@pytest.mark.parametrize("what", KIND)
def test_the_kind_of_a_failure_has_nothing_that_was_measured(what, plant_file, fmu):
    kind, limits = KIND[what]
    own = bench(plant_file, fmu(Fault(what)), HANG_LIMIT if what == "spin" else 10.0, limits=limits)
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert result.kind == kind


def measured(number: int, index: int):
    """Failures that differ in what was measured."""
    place, told = Place(number, CONTROLLER, ("set", "step", "get")[number % 3]), "it used too much memory"
    error = {"status": ERROR, "time": 0.1 * number, "message": f"x.fmu: fmi2DoStep returned error\n  {number}"}
    return {
        "died": Died(index, False, f"it used {2.0 + number} GB of memory", told, 1.0, place),
        "failed": Failed(index, FmuError(f"x.fmu: reading {number:#x}", "instantiation"), 1.0),
        "finished": Finished(index, error, 1.0),
    }


@pytest.mark.parametrize("how", ["died", "failed", "finished"])
def test_failures_that_differ_in_what_was_measured_are_of_one_kind(how, plant_file, fmu):
    own = bench(plant_file, fmu(fmus.NONE))
    cases = short_cases(own.plant, (STRUCK,) * 4)

    def execute(jobs):
        for index in range(4):
            yield 0, measured(index, index)[how]

    found = list(evaluation.evaluate(PROTOCOL, cases, own, execute))
    assert [result.status for result in found[:3]] == [found[0].status] * 3
    assert found[3].status is Status.SKIPPED
    assert found[0].kind in found[3].message


def test_a_worker_that_was_lost_is_no_failure_of_the_controller(plant_file, fmu):
    own = bench(plant_file, fmu(fmus.NONE))
    cases = short_cases(own.plant, (STRUCK,) * 4)
    lost = [cluster._lost(index, "a worker") for index in range(4)]
    found = list(evaluation.evaluate(PROTOCOL, cases, own, lambda jobs: ((0, outcome) for outcome in lost)))
    assert [(result.status, result.final) for result in found] == [(CRASHED, False)] * 4


@pytest.mark.parametrize(("what", "status"), [("status:3", DONE), ("abort", CRASHED)])
def test_what_goes_wrong_at_the_end_has_the_time_of_the_end(what, status, plant_file, fmu):
    own = bench(plant_file, fmu(Fault(what, "terminate", 0.0)))
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert (result.status, result.time) == (status, float(STRUCK))


def test_a_hang_on_the_way_is_waited_for_once(plant_file, fmu, monkeypatch):
    """What ran before in the process may keep the next case from starting; a hang on the way is the case's own."""
    starts = []
    started = isolation.started
    monkeypatch.setattr(isolation, "started", lambda job: starts.append(job) or started(job))
    own = bench(plant_file, fmu(Fault("spin", "step", 0.02, ONLY_STRUCK)), HANG_LIMIT)
    results = run(own, short_cases(own.plant, (SPARED, STRUCK)))
    assert [result.status for result in results] == [DONE, TIMEOUT]
    assert len(starts) == 1


# ---- The rehearsal ----


@pytest.fixture
def short_start(monkeypatch):
    """A rehearsal that waits as long as a short case does."""
    monkeypatch.setattr(evaluation, "FIRST_START_TIME", HANG_LIMIT)


@pytest.mark.parametrize(
    ("fault", "status", "words"),
    [
        (Fault("segfault", "step", 0.0), CRASHED, ("SIGSEGV, in the call 'fmi2DoStep'", "to follow a bad pointer")),
        (Fault("segfault", "initialize", 0.0), CRASHED, ("SIGSEGV, in the call 'enterInitializationMode'",)),
        (Fault("spin", "step", 0.0), TIMEOUT, ("the time limit was reached, in the call 'fmi2DoStep'",)),
        (Fault("spin", "instantiate", 0.0), TIMEOUT, ("in the call 'instantiation' of the controller",)),
    ],
    ids=str,
)
def test_who_does_not_come_through_the_first_sample_is_told_at_once(fault, status, words, plant_file, fmu, short_start):
    own = replace(bench(plant_file, fmu(fault)), timeout=2.0)
    cases = short_cases(own.plant, (STRUCK,) * 4)
    failure = rehearse(cases[0], own).failure
    assert failure is not None and (failure.case, failure.status, failure.time) == (cases[0], status, 0.0)
    for word in words:
        assert word in failure.message

    def never(jobs):
        raise AssertionError("nothing is to be run")

    found = list(evaluation.evaluate(PROTOCOL, cases, own, never, at_once=failure))
    assert found[0] == failure
    assert [(result.case, result.status) for result in found[1:]] == [(case, Status.SKIPPED) for case in cases[1:]]
    assert f"a failure in the first sample ({status.value}: {failure.kind}); --keep-going" in found[1].message
    again = list(evaluation.evaluate(PROTOCOL, cases[1:], own, never, [failure], at_once=failure))
    assert again == found[1:]  # a run that was interrupted after the first result


@pytest.mark.parametrize(
    "fault",
    [
        Fault("abort", "step", 0.02),
        Fault("abort", "terminate", 0.0),
        Fault("segfault", "initialize", 0.0, which=2),
        Fault("kill:9", "step", 0.0),
    ],
    ids=str,
)
def test_what_does_not_show_in_the_first_sample_is_left_to_the_cases(fault, plant_file, fmu):
    own = bench(plant_file, fmu(fault))
    assert rehearse(short_cases(own.plant, (STRUCK,))[0], own).failure is None


def test_the_rehearsal_gives_those_more_time_whose_cases_have_more(plant_file, fmu, short_start):
    own = bench(plant_file, fmu(fmus.NONE))
    patient = replace(own, timeout=240.0)
    limits = []

    def note(job):
        limits.append(job.time_limits)
        return iter(())

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(evaluation, "run_isolated", note)
        rehearse(short_cases(own.plant, (STRUCK,))[0], patient)
    assert limits[0][0] == pytest.approx(120.0, abs=0.01)


def test_keep_going_runs_all_and_what_failed_again(fmu, tmp_path):
    file = str(fmu(Fault("abort", "step", 0.0)))
    options = ("--quick", "--only", "c00.*")
    tables = []
    for more in ((), ("--keep-going",), ("--keep-going",), ()):
        done = finished(command(tmp_path, file, *options, *more))
        assert done.returncode == 1
        assert ("earlier run (--force runs anew, --keep-going what failed)" in done.stderr) == (len(tables) == 3)
        with (tmp_path / "cases.csv").open() as table:
            tables.append([row["status"] for row in csv.DictReader(table)])
    assert tables[0] == ["crashed"] + ["skipped"] * (len(tables[0]) - 1)
    assert tables[1] == tables[2] == tables[3] == ["crashed"] * len(tables[0])


# ---- The start of a child ----

REPORTING = """
import sys

def work(plant, controller, task):
    main = sys.modules.get("__mp_main__")
    return getattr(getattr(main, "__spec__", None), "name", ""), "orchestrator.evaluate" in sys.modules
"""


def test_a_child_does_not_import_the_command(plant_file, fmu, tmp_path, monkeypatch):
    (tmp_path / "reporting.py").write_text(REPORTING)
    monkeypatch.syspath_prepend(str(tmp_path))
    monkeypatch.setattr(sys.modules["__main__"], "__spec__", find_spec("orchestrator.evaluate"))
    main = sys.modules["__main__"]
    own = bench(plant_file, fmu(fmus.NONE))
    jobs = [Job(own.plant, own.controller, (0,), import_module("reporting").work, (60.0,)) for _ in range(6)]
    for _, outcome in pool.run(jobs, workers=3):
        assert isinstance(outcome, Finished), outcome
        assert outcome.value[0] != "orchestrator.evaluate"
        assert not outcome.value[1]
    assert sys.modules["__main__"] is main


def test_work_of_a_script_of_ones_own_is_found(plant_file, fmu, tmp_path):
    script = tmp_path / "script.py"
    script.write_text(f"""
from orchestrator.cosim.archive import open_archive
from orchestrator.execution.isolation import run_isolated
from orchestrator.execution.job import Job
from pathlib import Path

def work(plant, controller, task):
    return task + 1

if __name__ == "__main__":
    plant, controller = (open_archive(Path(file)) for file in {(str(plant_file), str(fmu(fmus.NONE)))!r})
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


def test_the_parent_never_loads_an_fmu(plant_file, fmu, healthy):
    """It may build and unpack, but no library of an FMU is mapped into it."""
    mapped = Path("/proc/self/maps").read_text()
    assert "/fmus/" not in mapped


def test_no_descriptor_or_child_stays_after_many_faults(plant_file, fmu):
    benches = [bench(plant_file, fmu(Fault(what)), limit=20.0) for what in ("abort", "exit:0", "status:3")]
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


def test_time_limits_follow_the_simulated_time(plant_file, fmu, monkeypatch):
    monkeypatch.setattr(evaluation, "START_TIME", 5.0)
    own = Bench(bench(plant_file, fmu(fmus.NONE)).plant, bench(plant_file, fmu(fmus.NONE)).controller, timeout=52.0)
    scenarios = [case.scenario for case in short_cases(own.plant, (Fraction(13), Fraction(26)))]
    assert own.job(scenarios, scenarios, rehearse, 5.0).time_limits == (5.0 + 26.0, 5.0 + 52.0)
