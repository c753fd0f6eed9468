"""FMUs for Windows: under Wine where it is installed, and everywhere in a host that loads Linux's libraries."""

import numpy as np
import pytest
from hostile.runs import SPARED, bench, short_cases
from hostile.windows import left_of_wine
from support.windows_fmus import for_windows, pretending, twin_of_wine

import build_fmus
from orchestrator.execution import launch
from orchestrator.fmi.archive import open_archive
from orchestrator.pairing.pairing import simulate

PID = ("DiagonalPID_C", "DiagonalPID_C_fmi1", "DiagonalPID_C_fmi3", "DiagonalPID_C_fmi3_scalars")
CONTROLLERS = (*PID, "DitheredLQG_C")


@pytest.fixture
def twin(tmp_path, monkeypatch):
    """A Wine that is none, with a host for Linux."""
    launch._end_fork_servers()  # one that runs has another PATH
    monkeypatch.setenv("PATH", twin_of_wine(tmp_path / "wine"))
    yield
    launch._end_fork_servers()


@pytest.fixture
def torques(native_plant_file):
    """A function: the torques that a controller commands in the first half second of a case, in a process apart."""

    def commanded(file):
        (case,) = short_cases((SPARED,))
        return simulate(bench(native_plant_file, file), case.scenario).command

    return commanded


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.needs("compiler", "x86_64-linux")
def test_in_another_process_it_gives_the_same_bits(name, fmu_folder, tmp_path, twin, torques):
    native = build_fmus.build(name, fmu_folder)
    file = pretending(native, tmp_path)
    np.testing.assert_array_equal(torques(file), torques(native))
    assert open_archive(file).way == "wine" and not left_of_wine()


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.needs("compiler", "wine", "mingw", "x86_64-linux")
def test_under_wine_it_gives_the_same_bits(name, fmu_folder, tmp_path, torques):
    native = build_fmus.build(name, fmu_folder)
    np.testing.assert_array_equal(torques(for_windows(native, tmp_path)), torques(native))
    assert not left_of_wine()


@pytest.mark.parametrize("isolated", [False, True], ids=["together", "apart"])
@pytest.mark.needs("compiler", "wine", "mingw", "x86_64-linux", "bubblewrap")
def test_a_sandbox_has_a_wine_of_its_own(isolated, pid_c_file, native_plant_file, tmp_path):
    file = for_windows(pid_c_file, tmp_path)
    (case,) = short_cases((SPARED,))
    inside = bench(native_plant_file, file, sandbox=True, isolated=isolated)
    alone = simulate(bench(native_plant_file, pid_c_file), case.scenario)
    np.testing.assert_array_equal(simulate(inside, case.scenario).command, alone.command)
    assert not left_of_wine()
