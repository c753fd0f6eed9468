"""An ordinary run leaves nothing behind in the package, which it sees read-only."""

from pathlib import Path

import pytest
from hostile.runs import bench, job

import orchestrator
from orchestrator.execution import interpreter
from orchestrator.execution.supervision import run_isolated
from plant_fmu import flexible_manipulator


@pytest.mark.needs("namespaces")
def test_a_controller_cannot_change_the_package_nor_the_libraries(plant_file, pid_file):
    (outcome,) = run_isolated(job(bench(plant_file, pid_file), "change_package", b""))
    assert outcome.value.decode() == "-1 -1 EROFS EROFS EROFS"


def test_all_packages_are_below_what_is_protected():
    folders = [Path(each) for each in interpreter.read_only_folders()]
    for module in (orchestrator, flexible_manipulator, pytest):
        assert any(folder in Path(module.__file__).resolve().parents for folder in folders)
    assert not any(one in other.parents for one in folders for other in folders)
