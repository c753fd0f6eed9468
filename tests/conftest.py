"""Where a test session keeps compiled code and extracted FMUs, and the FMUs that tests share."""

from __future__ import annotations

import hashlib
import os
import signal
from collections.abc import Callable
from pathlib import Path

import pytest
from hostile.fmus import Fault, hostile_fmu
from hypothesis import settings

import build_fmus

# A test run is repeatable: the same examples every time. New ones are searched with --hypothesis-profile=search.
# No deadlines: compilation and a busy machine are no faults.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("search", deadline=None, print_blob=True)
settings.load_profile("repeatable")

PLANT_SOURCES = Path(build_fmus.__file__).parent / "plant_fmu"


def pytest_configure(config: pytest.Config) -> None:
    """Keep caches in the session's cache folder, for child processes too; the user's own are left alone.

    Numba looks for changes only in the file of the function it compiles, and would test stale machine code after a
    change in a helper of another module: the plant's sources get a folder by their hash.
    """
    folder = config.cache.mkdir("flexible-manipulator")
    digest = hashlib.sha256()
    for source in sorted(PLANT_SOURCES.rglob("*.py")):
        digest.update(source.read_bytes())
    os.environ.setdefault("FLEXIBLE_MANIPULATOR_CACHE", str(folder))
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


@pytest.fixture(scope="session")
def plant_file(fmu_folder: Path) -> Path:
    """The manipulator's FMU."""
    return build_fmus.build("FlexibleManipulator", fmu_folder)


@pytest.fixture(scope="session")
def native_plant_file(fmu_folder: Path) -> Path:
    """The manipulator's FMU in C."""
    return build_or_skip(lambda: build_fmus.build("FlexibleManipulatorNative", fmu_folder))


@pytest.fixture(scope="session", params=["plant_file", "native_plant_file"])
def each_plant_file(request: pytest.FixtureRequest) -> Path:
    """The manipulator's FMU, in Python and in C."""
    return request.getfixturevalue(request.param)


@pytest.fixture(scope="session")
def pid_file(fmu_folder: Path) -> Path:
    """The default controller's FMU, the one in Python."""
    return build_fmus.build("DiagonalPID", fmu_folder)


@pytest.fixture(scope="session")
def pid_c_file(fmu_folder: Path) -> Path:
    """The default controller's FMU, the one in C."""
    return build_or_skip(lambda: build_fmus.build("DiagonalPID_C", fmu_folder))


@pytest.fixture(scope="session")
def quick_folder(pid_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of one quick evaluation of the default controller, with the cases a report shows."""
    from orchestrator import Benchmark, Controller

    folder = tmp_path_factory.mktemp("quick")
    Benchmark("quick", workers=2).evaluate(Controller(pid_file), folder=folder)
    return folder


@pytest.fixture(scope="session")
def quick(quick_folder: Path):
    """The evaluation stored there."""
    from orchestrator import Evaluation

    return Evaluation.load(quick_folder)


@pytest.fixture(scope="session")
def probe_plant_file(fmu_folder: Path) -> Path:
    """The stub of ``tests/stubs/probe_plant.c``."""
    from support.stub_fmus import PROBE_PLANT, build_stub

    return build_or_skip(lambda: build_stub("probe_plant", PROBE_PLANT, fmu_folder))


@pytest.fixture(scope="session")
def feedthrough_file(fmu_folder: Path) -> Path:
    """The stub of ``tests/stubs/feedthrough.c``."""
    from support.stub_fmus import FEEDTHROUGH, build_stub

    return build_or_skip(lambda: build_stub("feedthrough", FEEDTHROUGH, fmu_folder))


def build_or_skip(build):
    """What ``build`` builds; the test is skipped where the machine has no C compiler."""
    try:
        return build()
    except build_fmus.NoCompilerError as problem:
        pytest.skip(str(problem))


@pytest.fixture(scope="session")
def faulty(fmu_folder: Path) -> Callable[[Fault], Path]:
    """A function that builds the hostile controller with a fault."""
    return lambda fault: build_or_skip(lambda: hostile_fmu(fmu_folder, fault))
