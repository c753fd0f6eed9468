"""FMUs for Windows: under Wine where it is installed, and everywhere in a host that loads Linux's libraries."""

import zipfile

import numpy as np
import pytest
from hostile.runs import SPARED, bench, short_cases
from hostile.windows import left_of_wine
from support.refusals import refusal
from support.windows_fmus import for_windows, pretending, twin_of_wine

import build_fmus
from controller_fmu.export.archive import pack
from controller_fmu.export.state_space import controller_from_state_space
from orchestrator.conformance.static import archive_findings
from orchestrator.execution import launch
from orchestrator.fmi.archive import open_archive
from orchestrator.fmi.host import build
from orchestrator.fmi.host.wine import PROGRAM
from orchestrator.pairing.pairing import simulate

T_S = 0.25e-3
PID = ("DiagonalPID_C", "DiagonalPID_C_fmi1", "DiagonalPID_C_fmi3", "DiagonalPID_C_fmi3_scalars")
MODEL_EXCHANGE = ("DiagonalPID_C_me2", "DiagonalPID_C_me3")
CONTROLLERS = (*PID, *MODEL_EXCHANGE, "DitheredLQG_C", "StateSpace")


@pytest.fixture
def twin(tmp_path, monkeypatch):
    """A Wine that is none, with a host for Linux."""
    launch._end_fork_servers()  # one that runs has another PATH
    monkeypatch.setenv("PATH", twin_of_wine(tmp_path / "wine"))
    yield
    launch._end_fork_servers()


@pytest.fixture
def built(fmu_folder, tmp_path):
    """A function: a controller of the project, or one in state space, by its name."""

    def file(name):
        if name != "StateSpace":
            return build_fmus.build(name, fmu_folder)
        A, B = np.diag([0.9, 0.8]), np.diag([0.1, 0.2])
        return controller_from_state_space(A, B, 40.0 * np.eye(2), 10.0 * np.eye(2), T_S, out=tmp_path / f"{name}.fmu")

    return file


@pytest.fixture
def torques(native_plant_file):
    """A function: the torques that a controller commands in the first half second of a case, in a process apart."""

    def commanded(file):
        (case,) = short_cases((SPARED,))
        return simulate(bench(native_plant_file, file), case.scenario).command

    return commanded


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.needs("compiler", "x86_64-linux")
def test_in_another_process_it_gives_the_same_bits(name, built, tmp_path, twin, torques):
    native = built(name)
    file = pretending(native, tmp_path / "windows")
    np.testing.assert_array_equal(torques(file), torques(native))
    assert open_archive(file).library == "wine" and not left_of_wine()


@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.needs("compiler", "wine", "mingw", "x86_64-linux")
def test_under_wine_it_gives_the_same_bits(name, built, tmp_path, torques):
    native = built(name)
    np.testing.assert_array_equal(torques(for_windows(native, tmp_path / "windows")), torques(native))
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


REFUSED = {"win32": ("no-binary", "32 bits"), "tool": ("execution-tool", "needs"), "none": ("no-wine", "Install Wine")}


@pytest.mark.parametrize("case", REFUSED)
@pytest.mark.needs("compiler", "x86_64-linux")
def test_what_cannot_run_is_refused_in_a_sentence(case, pid_c_file, tmp_path, monkeypatch):
    with zipfile.ZipFile(pretending(pid_c_file, tmp_path / "plain")) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    if case == "win32":
        files = {name.replace("win64", case): content for name, content in files.items()}
    if case == "tool":
        head = files["modelDescription.xml"]
        files["modelDescription.xml"] = head.replace(b"<CoSimulation", b'<CoSimulation needsExecutionTool="true"')
    if case == "none":
        monkeypatch.setenv("PATH", str(tmp_path))
    file = tmp_path / "refused.fmu"
    file.write_bytes(pack(files))
    code, words = REFUSED[case]
    error = refusal(open_archive, file)
    assert (error.what, words in str(error)) == (code, True), error


@pytest.mark.needs("compiler", "x86_64-linux")
def test_the_library_is_chosen_in_order(pid_c_file, tmp_path, twin):
    with zipfile.ZipFile(pid_c_file) as archive:
        files = {name: archive.read(name) for name in archive.namelist()}
    library = next(name for name in files if name.endswith(".so"))
    files[f"binaries/win64/{pid_c_file.stem}.dll"] = files[library]
    file, chosen = tmp_path / "all.fmu", []
    for left_out in ("nothing", library, "sources/"):
        files = {name: content for name, content in files.items() if not name.startswith(left_out)}
        file.write_bytes(pack(files))
        chosen.append(open_archive(file).library)
    assert chosen == ["native", "source", "wine"]
    assert refusal(open_archive, file, "native").what == refusal(open_archive, file, "source").what == "no-binary"
    assert open_archive(pid_c_file, "source").library_file.is_file() and open_archive(pid_c_file).library == "native"


@pytest.mark.needs("compiler", "x86_64-linux")
def test_the_check_says_what_it_runs_under(pid_c_file, tmp_path, twin):
    found = list(archive_findings(open_archive(pretending(pid_c_file, tmp_path))))
    (library,) = (finding for finding in found if finding.subject == "library")
    assert library.severity == "note" and "runs under Wine 0.0" in library.text


@pytest.mark.needs("compiler", "x86_64-linux")
def test_a_library_is_found_whatever_its_capitals(pid_c_file, tmp_path, twin):
    with zipfile.ZipFile(pretending(pid_c_file, tmp_path)) as archive:
        files = {name.replace(".dll", ".DLL"): archive.read(name) for name in archive.namelist()}
    file = tmp_path / "capitals.fmu"
    file.write_bytes(pack(files))
    found = open_archive(file)
    assert found.library == "wine" and found.library_file.suffix == ".DLL" and found.platforms == ("win64",)


@pytest.mark.slow  # ziglang first compiles its C library for Windows
@pytest.mark.needs("ziglang")
def test_the_host_is_made_of_its_source(tmp_path):
    build.build(tmp_path / "host.exe")
    assert (tmp_path / "host.exe").read_bytes() == PROGRAM.read_bytes()
