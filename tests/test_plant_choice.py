"""Which manipulator is simulated: the native one only where it has proven equal, and the same numbers either way."""

from __future__ import annotations

import logging
import shutil
from pathlib import Path

import pytest

import build_fmus
from orchestrator import Benchmark, Controller, InputError, compare
from orchestrator.api.plant import choose

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


def test_without_a_compiler_the_plant_is_the_one_in_python_and_a_note_says_what_would_be_faster(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv("CC", "no-such-compiler")
    with caplog.at_level(logging.INFO, "orchestrator"):
        assert choose("auto").build == "python"
    (record,) = caplog.records
    assert record.what == "no-native"  # type: ignore[attr-defined]


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("flaw", ["-Dexp=tanh", "-Dcos=sin", "-include /no/such/header.h"])
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
