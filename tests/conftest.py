"""Where a test session keeps compiled code and extracted FMUs, and the FMUs that tests share."""

import hashlib
import os
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import pytest
from hostile.commands import NOISE
from hostile.fmus import NONE, Fault, hostile_fmu
from hostile.runs import HANG_LIMIT, bench
from hypothesis import settings
from support import passed, tools
from support.stub_fmus import FEEDTHROUGH, PROBE_PLANT, build_stub
from support.tools import PRESENT, require

import build_fmus
from orchestrator import Benchmark, Controller, Evaluation
from orchestrator.pairing import pairing
from orchestrator.pairing.pairing import Pairing

# A test run is repeatable: the same examples every time. New ones are searched with --hypothesis-profile=search.
# No deadlines: compilation and a busy machine are no faults.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None, print_blob=True)
settings.load_profile("repeatable")

PLANT_SOURCES = Path(build_fmus.__file__).parent / "plant_fmu"


def pytest_addoption(parser: pytest.Parser) -> None:
    """The options of the plugin for `.ci/run`."""
    passed.add_options(parser)


def pytest_configure(config: pytest.Config) -> None:
    """Keep caches in the session's cache folder, for child processes too; the user's own are left alone.

    With pytest-xdist each worker has its own, as some tests spoil what others use.

    Numba looks for changes only in the file of the function it compiles, and would test stale machine code after a
    change in a helper of another module: the plant's sources get a folder by their hash.
    """
    for plugin in (tools, passed):
        config.pluginmanager.register(plugin)
    worker = os.environ.get("PYTEST_XDIST_WORKER", "")
    if getattr(config.option, "numprocesses", None) and not worker:
        return  # tests run in the workers, which inherit this environment
    folder = config.cache.mkdir(f"flexible-manipulator{worker}")
    digest = hashlib.sha256()
    for source in sorted(PLANT_SOURCES.rglob("*.py")):
        digest.update(source.read_bytes())
    os.environ.setdefault("FLEXIBLE_MANIPULATOR_CACHE", str(folder))
    # What zig compiles of the C library is many times what the tests compile with it: all workers share one folder.
    os.environ.setdefault("ZIG_GLOBAL_CACHE_DIR", str(config.cache.mkdir("zig")))
    os.environ.setdefault("NUMBA_CACHE_DIR", str(folder / "numba-plant" / digest.hexdigest()[:16]))
    # A session started in the background by a script ignores Ctrl-C, and so would the commands it starts to interrupt.
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)


@pytest.fixture(scope="session")
def fmu_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the session's FMUs."""
    return tmp_path_factory.mktemp("session_fmus")


@pytest.fixture(scope="session")
def exporter_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder of the FMUs of ``tests/exporters``: a recipe builds its own there when it is first asked for."""
    return tmp_path_factory.mktemp("exporters")


def built(build: Callable[[Path], Path], *needs: str) -> Any:
    """A fixture of an FMU that ``build`` builds in the session's folder; ``needs`` are tools of ``support.tools``."""

    @pytest.fixture(scope="session")
    def file(fmu_folder: Path) -> Path:
        require(*needs)
        return build(fmu_folder)

    return file


plant_file = built(partial(build_fmus.build, "FlexibleManipulator"))
native_plant_file = built(partial(build_fmus.build, "FlexibleManipulatorNative"), "compiler")
pid_file = built(partial(build_fmus.build, "DiagonalPID"))
pid_c_file = built(partial(build_fmus.build, "DiagonalPID_C"), "compiler")
probe_plant_file = built(partial(build_stub, "probe_plant", PROBE_PLANT))
feedthrough_file = built(partial(build_stub, "feedthrough", FEEDTHROUGH))


@pytest.fixture(scope="session")
def quick_pid_file(request: pytest.FixtureRequest) -> Path:
    """The PID for tests to which it is all the same: in C where there is a compiler, since that is faster."""
    return request.getfixturevalue("pid_c_file" if PRESENT["compiler"] else "pid_file")


@pytest.fixture(scope="session")
def quick_plant_file(request: pytest.FixtureRequest) -> Path:
    """The manipulator for tests to which it is all the same, likewise."""
    return request.getfixturevalue("native_plant_file" if PRESENT["compiler"] else "plant_file")


@pytest.fixture(scope="session", params=["plant_file", "native_plant_file"])
def each_plant_file(request: pytest.FixtureRequest) -> Path:
    """The manipulator's FMU, in Python and in C."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def quick_folder(pid_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one quick evaluation of the default controller, with the cases a report shows."""
    folder = tmp_path_factory.mktemp("quick")
    Benchmark("quick", workers=2).evaluate(Controller(pid_file), folder=folder)
    return folder


@pytest.fixture(scope="session")
def quick(quick_folder: Path):
    """The evaluation stored there."""
    return Evaluation.load(quick_folder)


@pytest.fixture(scope="session")
def undisturbed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of the evaluation that tests disturb, kill and send to a cluster, run here and without trouble."""
    folder = tmp_path_factory.mktemp("undisturbed")
    Benchmark(workers=2).evaluate(Controller(), only=NOISE[1], folder=folder, recordings=False)
    return folder


@pytest.fixture(scope="session")
def faulty(fmu_folder: Path) -> Callable[[Fault], Path]:
    """A function that builds the hostile controller with a fault."""
    return partial(hostile_fmu, fmu_folder)


@pytest.fixture(scope="session")
def own(plant_file: Path, pid_file: Path) -> Pairing:
    """The plant with the default controller."""
    return bench(plant_file, pid_file)


@pytest.fixture(scope="session")
def harmless(plant_file: Path, faulty: Callable[[Fault], Path], request: pytest.FixtureRequest) -> Pairing:
    """The plant with the hostile controller, without a fault; with the PID where there is no compiler for it."""
    return bench(plant_file, faulty(NONE) if PRESENT["compiler"] else request.getfixturevalue("pid_file"))


@pytest.fixture
def no_slack(monkeypatch: pytest.MonkeyPatch) -> None:
    """Time limits in proportion to the simulated time alone, and what comes on top of them short."""
    monkeypatch.setattr(pairing, "START_TIME", 0.0)
    monkeypatch.setattr(pairing, "FIRST_START_TIME", HANG_LIMIT)
