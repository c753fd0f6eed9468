"""Reference trajectories: files with which the FMUs can be compared in other tools."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from fmpy.util import read_csv
from support.pid_fmus import built

import build_fmus
from controller_fmu.export.trajectories import STEPS

ROOT = Path(build_fmus.__file__).parent

IN_FMPY = """
import sys, fmpy, numpy
fmu, inputs, target, step = sys.argv[1:]
given = fmpy.read_csv(inputs)
found = fmpy.simulate_fmu(fmu, input=given, stop_time=given["time"][-1], output_interval=float(step))
fmpy.write_csv(target, found)
"""
# pythonfmu 0.7.0 writes to freed memory when its library is torn down at exit: one process in ten died of SIGABRT.
IN_PYTHON = """
import os, sys, pathlib
from controller_fmu.export.trajectories import reference
for name, text in zip(("in", "ref"), reference(pathlib.Path(sys.argv[1]))):
    pathlib.Path(sys.argv[2], f"FlexibleManipulatorNative_{name}.csv").write_text(text)
os._exit(0)
"""


def run(script: str, *words: object) -> None:
    """In a process of its own: a test process never loads an FMU."""
    subprocess.run([sys.executable, "-c", script, *map(str, words)], cwd=ROOT, check=True, stdout=subprocess.DEVNULL)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The trajectories of plant, PID and imperfections."""
    folder = tmp_path_factory.mktemp("references")
    script = "import sys, build_fmus; [build_fmus.build_references(n, sys.argv[1], ('x',)) for n in sys.argv[2:]]"
    run(script, folder, "FlexibleManipulatorNative_me2", "DiagonalPID_C", "Imperfections")
    return folder


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("name", ["FlexibleManipulatorNative", "DiagonalPID_C", "Imperfections"])
def test_fmpy_computes_the_trajectory(name, folder, fmu_folder, tmp_path):
    expected = read_csv(folder / f"{name}_ref.csv")
    assert len(expected) == STEPS + 1 and len(read_csv(folder / f"{name}_in.csv")) == STEPS + 1
    run(IN_FMPY, built(name, fmu_folder), folder / f"{name}_in.csv", tmp_path / "found.csv", expected["time"][1])
    found = read_csv(tmp_path / "found.csv")
    for variable in expected.dtype.names:
        np.testing.assert_allclose(found[variable], expected[variable], rtol=1e-9, atol=1e-9)
    assert all(np.ptp(expected[variable]) > 0.0 for variable in expected.dtype.names if variable[0] in "qX")


IN_MODEL_EXCHANGE = """
import sys, fmpy, numpy
fmu, inputs, target, holds = sys.argv[1:]
given = fmpy.read_csv(inputs)
ends = given[:-1].copy()
ends["time"] = given["time"][1:]
held = numpy.stack([given[:-1], ends], axis=1).reshape(-1)
options = {"solver": "CVode", "relative_tolerance": 1e-7, "output_interval": given["time"][1], "record_events": False}
found = fmpy.simulate_fmu(fmu, input=held if holds == "True" else given, stop_time=given["time"][-1], **options)
fmpy.write_csv(target, found)
"""


@pytest.mark.needs("compiler")
@pytest.mark.parametrize(
    ("holds", "least", "most"), [(True, 0.0, 3e-4), (False, 3e-3, 0.1)], ids=["held", "interpolated"]
)
def test_model_exchange_comes_near_it_if_inputs_are_held(holds, least, most, folder, fmu_folder, tmp_path):
    name = "FlexibleManipulatorNative"
    files = built(f"{name}_me2", fmu_folder), folder / f"{name}_in.csv"
    expected = read_csv(folder / f"{name}_ref.csv")
    run(IN_MODEL_EXCHANGE, *files, tmp_path / "found.csv", holds)
    found = read_csv(tmp_path / "found.csv")
    assert least <= max(np.abs(found[q] - expected[q]).max() for q in ("q_m[1]", "q_m[2]")) <= most


@pytest.mark.needs("compiler")
def test_it_is_that_of_the_manipulator_in_python(folder, plant_file, tmp_path):
    run(IN_PYTHON, plant_file, tmp_path)
    for file in tmp_path.iterdir():
        assert file.read_text() == (folder / file.name).read_text(), file.name
    assert len(list(tmp_path.iterdir())) == 2


@pytest.mark.needs("ziglang", "x86_64-linux")
def test_the_files_lie_beside_what_is_built_for_platforms(folder, tmp_path, capsys):
    names, platforms = ("DiagonalPID", "DiagonalPID_C", "DiagonalPID_C_fmi3"), ("x86_64-linux",)
    planned = build_fmus.to_build(names, tmp_path, platforms)
    assert build_fmus.main([*names, "--platforms", *platforms, "--output-dir", str(tmp_path)]) == 0
    assert capsys.readouterr().out.split() == [str(file) for file in planned]
    assert {file.name for file in tmp_path.iterdir()} == {file.name for file in planned}
    assert (tmp_path / "DiagonalPID_C_ref.csv").read_text() == (folder / "DiagonalPID_C_ref.csv").read_text()
    assert build_fmus.references("DiagonalPID_C", tmp_path) == ()


@pytest.mark.needs("ziglang", "x86_64-linux")
def test_the_binary_of_a_platform_has_the_same_bytes_each_time_and_gives_the_trajectory(folder, tmp_path):
    name = "FlexibleManipulatorNative"
    once = build_fmus.build(name, tmp_path, ("x86_64-linux",)).read_bytes()
    fmu = build_fmus.build(name, tmp_path, ("x86_64-linux",))
    assert fmu.read_bytes() == once
    run(IN_PYTHON, fmu, tmp_path)
    assert (tmp_path / f"{name}_ref.csv").read_text() == (folder / f"{name}_ref.csv").read_text()
