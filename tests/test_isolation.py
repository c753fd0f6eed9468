"""Whatever a controller does costs its own case a status: a corpus of hostile FMUs, each run before a healthy case."""

from __future__ import annotations

import sys
import time
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

import psutil
import pytest
from hostile import fmus
from hostile.fmus import Fault
from hostile.runs import SPARED, STRUCK, bench, run, short_cases

from orchestrator.benchmark.metrics import CaseResult
from orchestrator.cosim.trajectory import Status
from orchestrator.execution import evaluation, isolation
from orchestrator.execution.job import Limits

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
    replace(crash("grow", "of memory; the limit is 400 MB"), limits=Limits(memory=400_000_000)),
    replace(crash("log:1", "logged more than 1 MB", "still here, and talking"), limits=Limits(output=1_000_000)),
    replace(crash("print", "printed or logged more than 1 MB", "no news"), limits=Limits(output=1_000_000)),
]


@pytest.fixture(autouse=True)
def no_slack(monkeypatch):
    """Time limits in proportion to the simulated time alone, and what comes on top of them short."""
    monkeypatch.setattr(evaluation, "START_TIME", 0.0)
    monkeypatch.setattr(isolation, "GRACE", 0.3)


@pytest.fixture(scope="module")
def healthy(plant_file, faulty) -> list[CaseResult]:
    """The results of the two cases with a controller without a fault."""
    own = bench(plant_file, faulty(fmus.NONE), limit=120.0)
    results = run(own, short_cases(own.plant, (STRUCK, SPARED)))
    assert [result.status for result in results] == [DONE, DONE]
    return results


@pytest.mark.parametrize("expected", [*CRASHES, *HANGS, *ERRORS, *HARMLESS, *FLOODS], ids=str)
def test_a_hostile_controller_costs_its_own_case_only(expected, plant_file, faulty, healthy):
    limit = HANG_LIMIT if expected.status is TIMEOUT else 10.0
    own = bench(plant_file, faulty(expected.fault), limit, limits=expected.limits)
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


def test_a_warning_is_counted(plant_file, faulty):
    own = bench(plant_file, faulty(Fault("status:1", "step", 0.02)))
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert (result.status, result.warnings) == (DONE, 120)


@pytest.mark.parametrize("what", ["segfault", "exit:0", "spin", "status:3"])
def test_a_controller_that_cannot_be_instantiated(what, plant_file, faulty):
    own = bench(plant_file, faulty(Fault(what, "instantiate", 0.0)), HANG_LIMIT)
    (result,) = run(own, short_cases(own.plant, (STRUCK,)))
    assert result.status is {"spin": TIMEOUT, "status:3": ERROR}.get(what, CRASHED)
    assert result.time == 0.0
    assert "instantiation" in result.message


def test_a_crash_in_the_second_instance_goes_away_in_a_process_of_its_own(plant_file, faulty, healthy):
    """Some FMUs can be instantiated once a process. The result of a case must not depend on the ones before it."""
    own = bench(plant_file, faulty(Fault("segfault", "initialize", 0.0, which=2)))
    results = run(own, short_cases(own.plant, (STRUCK, SPARED, STRUCK)))
    assert [result.status for result in results] == [DONE] * 3
    assert results[1].measurement == healthy[1].measurement


def test_a_case_whose_process_is_killed_from_outside_is_run_again(plant_file, faulty, healthy, monkeypatch):
    started, kills = isolation.started, []

    @contextmanager
    def killed_once(job, stop):
        with started(job, stop) as child:
            if not kills:
                kills.append(child.process.kill())
            yield child

    monkeypatch.setattr(isolation, "started", killed_once)
    own = bench(plant_file, faulty(fmus.NONE))
    results = run(own, short_cases(own.plant, (STRUCK, SPARED)))
    assert len(kills) == 1
    assert [result.measurement for result in results] == [result.measurement for result in healthy]


@pytest.mark.parametrize("what", ["daemon", "daemon-session", "daemon-crash"])
def test_no_process_stays_behind(what, plant_file, faulty):
    own = bench(plant_file, faulty(Fault(what, "terminate" if what != "daemon-crash" else "step", 0.0)))
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


def test_what_an_fmu_writes_over_itself_is_mended(plant_file, faulty, healthy):
    file = faulty(Fault("spoil", "terminate", 0.0))
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
