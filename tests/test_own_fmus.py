"""The benchmark's FMUs in Python, stepped as machine code: which FMUs, and the same bits as by themselves and in C."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from test_golden import COSTS, GOLDEN

import build_fmus
from controller_fmu.export.archive import pack, unpack
from orchestrator import Benchmark, Controller
from orchestrator.fmi.archive import open_archive
from orchestrator.fmi.slaves.numba_slave import compiled_twin_of

SIGNALS = ("time", "q_m", "X", "measured", "command", "torque")
CASE = "c07.random_1.disturbance"


def changed(fmu: Path, target: Path, **contents: bytes) -> Path:
    """``fmu`` with other ``contents`` of its resources, which it computes the same with."""
    files = {f"resources/{name.replace('__', '/')}.py": content for name, content in contents.items()}
    target.write_bytes(pack({**unpack(fmu), **files}))
    return target


@pytest.fixture(scope="module")
def unlike(plant_file: Path, pid_file: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Plant and PID with one more module, so that pythonfmu steps them."""
    folder = tmp_path_factory.mktemp("unlike")
    return tuple(changed(file, folder / file.name, another=b"") for file in (plant_file, pid_file))  # type: ignore


def test_an_fmu_is_stepped_as_machine_code_if_it_has_the_source_of_this_package(
    plant_file: Path, pid_file: Path, unlike: tuple[Path, Path], fmu_folder: Path, tmp_path: Path
) -> None:
    assert [compiled_twin_of(open_archive(file)) for file in (plant_file, pid_file)] == ["numba_plant", "numba_pid"]
    source = unpack(plant_file)["resources/flexible_manipulator/integrator.py"]
    others = (
        *unlike,
        changed(plant_file, tmp_path / "a.fmu", flexible_manipulator__integrator=source + b"\n"),
        build_fmus.build("TunedPID", fmu_folder),
        build_fmus.build("ManipulatorLQG", fmu_folder),
    )
    assert [compiled_twin_of(open_archive(file)) for file in others] == [None] * len(others)


def test_machine_code_gives_the_bits_of_the_fmus_themselves(
    plant_file: Path, pid_file: Path, unlike: tuple[Path, Path]
) -> None:
    runs = [
        Benchmark(plant=plant).simulate(Controller(pid), CASE)
        for plant, pid in ((plant_file, pid_file), unlike, (plant_file, unlike[1]), (unlike[0], pid_file))
    ]
    for name in SIGNALS:
        first, *others = (getattr(run.trajectory, name) for run in runs)
        assert all(np.array_equal(first, other) for other in others), name
    assert [run.result for run in runs] == [runs[0].result] * len(runs)


@pytest.mark.slow
@pytest.mark.parametrize("plant", ["auto", "python"])
@pytest.mark.parametrize("default", [True, False])
def test_default_and_python_give_the_published_cases_in_every_combination(plant, default, pid_file, tmp_path) -> None:
    """``tests/golden`` was written by the FMUs in Python, stepped by pythonfmu."""
    controller = Controller() if default else Controller(pid_file)
    evaluation = Benchmark("quick", plant=plant).evaluate(controller, recordings=False)
    in_c = build_fmus.find_compiler() is not None
    assert evaluation.results.controller.file == ("DiagonalPID_C.fmu" if default and in_c else "DiagonalPID.fmu")
    assert evaluation.results.plant.build == ("native" if plant == "auto" and in_c else "python")
    written = (evaluation.save(tmp_path) / "cases.csv").read_text(encoding="utf-8")
    assert written == (GOLDEN / "DiagonalPID.quick.csv").read_text(encoding="utf-8")
    assert evaluation.cost == COSTS["DiagonalPID", "quick"]


def test_a_step_of_another_length_than_the_sample_time_is_an_error_of_the_pid(pid_file: Path) -> None:
    code = f"""
import ctypes, os, sys
from pathlib import Path
from orchestrator.fmi.archive import open_archive
from orchestrator.fmi.slaves import load
slave = load(open_archive(Path({str(pid_file)!r})))
with slave.instantiated(1.0):
    slave.initialize({{}}, {{}})
    port = slave.port([], [])
    kind = ctypes.CFUNCTYPE(ctypes.c_int, ctypes.c_void_p, ctypes.c_double, ctypes.c_double, ctypes.c_int)
    print(*(kind(port.do_step)(port.instance, 0.0, step, 1) for step in (0.25e-3, 0.5e-3, float("nan"))))
    sys.stdout.flush()
    os._exit(0)  # pythonfmu's library must not be torn down with the interpreter
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["0", "3", "3"]


# ---- What a process loads ----


def test_a_simulation_loads_neither_the_compiler_nor_scipy_into_the_users_process(tmp_path: Path) -> None:
    code = """
import sys
from orchestrator.cli.guard import run
assert run("simulate", ["--duration", "0.5", "--undisturbed"]) == 0
print([name for name in ("numba", "scipy", "llvmlite") if name in sys.modules])
"""
    told = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert told.stdout.splitlines()[-1] == "[]"


def test_what_is_not_loaded_at_the_start_of_a_process_can_be_loaded_later() -> None:
    code = """
import gc
from orchestrator.execution.interpreter import lean_imports
with lean_imports():
    import numba
    try:
        import scipy
    except ImportError:
        print("hidden")
import numpy as np, scipy.linalg
assert gc.isenabled()
print(numba.njit(lambda a: np.linalg.inv(a))(2.0 * np.eye(2))[0, 0])
"""
    told = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert told.stdout.split() == ["hidden", "0.5"]
