"""Which manipulator is simulated: the native one only where it has proven equal, and the same numbers either way."""

from __future__ import annotations

import json
import logging
import shutil
from pathlib import Path

import pytest
from support.command_lines import call

import build_fmus
from orchestrator import Benchmark, Controller, InputError, compare
from orchestrator.pairing import built_in as built_in_fmus
from orchestrator.pairing.built_in import choose

ONE = "c00.compliant.noise"


@pytest.fixture
def evaluated(pid_file: Path):
    def run(plant: str | Path):
        return Benchmark(plant=plant).evaluate(Controller(pid_file), only=ONE, recordings=False)

    return run


@pytest.mark.needs("compiler")
def test_both_builds_and_a_file_give_the_same_cases_and_are_ranked_together(evaluated, native_plant_file) -> None:
    runs = {plant: evaluated(plant) for plant in ("auto", "native", "python", native_plant_file)}
    assert all(run.cases == runs["auto"].cases for run in runs.values())
    assert [run.results.plant.build for run in runs.values()] == ["native", "native", "python", "file"]
    assert [run.results.plant.path for run in runs.values()] == ["", "", "", str(native_plant_file)]
    own, foreign = compare(list(runs.values()))
    assert len(own.unranked) == 3 and foreign.difference.startswith("plant of contents")


def test_without_a_compiler_plant_and_default_controller_are_those_in_python_without_a_warning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with caplog.at_level(logging.INFO, "orchestrator"):
        assert choose("auto").build == "python"
        assert Controller().archive.name == "DiagonalPID.fmu"
    assert not caplog.records


@pytest.mark.needs("compiler")
def test_the_default_controller_is_the_one_in_c_only_if_it_has_proven_equal(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    assert Controller().archive.name == "DiagonalPID_C.fmu"
    assert Controller().name == "DiagonalPID", "the folder of its results has one name on all machines"
    monkeypatch.setenv("FLEXIBLE_MANIPULATOR_CACHE", str(tmp_path))  # where nothing is proven yet
    monkeypatch.setattr(built_in_fmus, "_are_equal", lambda python, native: False)
    assert Controller().archive.name == "DiagonalPID.fmu"
    assert [record.levelno for record in caplog.records] == [logging.WARNING]


@pytest.mark.parametrize("compiler", [True, False])
def test_one_line_says_which_builds_are_simulated(compiler: bool, pid_file: Path, tmp_path: Path, monkeypatch) -> None:
    if not compiler:
        monkeypatch.setenv("CC", "no-such-compiler")
    in_c = build_fmus.find_compiler() is not None
    plant = "FlexibleManipulatorNative.fmu (in C)" if in_c else "FlexibleManipulator.fmu (in Python, compiled by Numba)"
    pid = "DiagonalPID_C.fmu (the paper's PID, in C)"
    pid = pid if in_c else "DiagonalPID.fmu (the paper's PID, in Python, compiled by Numba)"
    command = ("evaluate", "--only", ONE, "--no-report", "--json")
    told = call(*command, folder=tmp_path)
    assert told.err.splitlines().count(f"controller {pid}, plant {plant}") == 1
    assert json.loads(told.out)["head"]["controller"]["file"] == pid.split(" ")[0]
    assert (tmp_path / "runs").is_dir() and next((tmp_path / "runs").iterdir()).name.startswith("DiagonalPID-paper")
    told = call("simulate", pid_file, "--plant", pid_file, folder=tmp_path)
    assert told.code == 2, "a PID is no plant"
    told = call("check", pid_file, folder=tmp_path)
    assert f"controller {pid_file.name}, plant {plant}" in told.err.splitlines()


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("flaw", ["-Dcopysign=fmax", "-ffast-math", "-include /no/such/header.h"])
def test_a_compiler_that_gives_other_bits_or_fails_is_not_used(
    flaw: str, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    (compiler, *_) = build_fmus.find_compiler() or ()
    monkeypatch.setenv("CC", f"{shutil.which(compiler)} {flaw}")
    for _ in range(2):  # what has failed is not taken for proven
        assert choose("auto").build == "python"
    assert all(record.levelno == logging.WARNING for record in caplog.records) and len(caplog.records) == 2


def test_a_file_must_be_the_manipulator(pid_file: Path) -> None:
    with pytest.raises(InputError) as error:
        Benchmark(plant=pid_file).evaluate(only=ONE)
    assert error.value.what == "no-plant" and error.value.where == pid_file.name


@pytest.mark.parametrize("field", ["timeout", "memory_limit"])
@pytest.mark.parametrize("value", [0.0, -1.0, float("inf"), float("nan")])
def test_limits_are_positive_and_finite(field: str, value: float) -> None:
    with pytest.raises(InputError) as error:
        Benchmark(**{field: value})
    assert (error.value.what, error.value.where) == ("bad-number", field)
