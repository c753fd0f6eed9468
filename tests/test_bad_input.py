"""What a user can get wrong, through the real commands: one clear message, exit code 2, nothing half done."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import pytest
from bad_fmus import for_windows, of_another_guid, with_broken_sources, without
from command_lines import command, environment, run
from exporters import REFUSED
from python_controllers import python_controller

EVALUATE = ("evaluate", "--quick", "--jobs", "1", "--no-report")


def refusal(folder, *arguments, changes=None):
    """What a refused command said: it has exit code 2, no traceback, and leaves nothing that looks like a result."""
    finished = run(*arguments, folder=folder, changes=changes)
    assert finished.code == 2, finished
    assert finished.out == ""
    assert "Traceback" not in finished.err
    lines = finished.err.splitlines()
    assert sum(": error: " in line or line.startswith("error: ") for line in lines if line[0] != " ") == 1, lines
    assert not list(folder.rglob("results.json")) and not list(folder.rglob("*.csv"))
    assert not list(folder.rglob("*incomplete*"))
    return finished.err[finished.err.index("error:") :]


@pytest.fixture(scope="module")
def controllers(pid_c_file, tmp_path_factory):
    """Unusable controllers by name."""
    folder = tmp_path_factory.mktemp("unusable")
    (folder / "text.fmu").write_text("this is no archive")
    with zipfile.ZipFile(folder / "zip.fmu", "w") as archive:
        archive.writestr("readme.txt", "no model description")
    (folder / "cut.fmu").write_bytes(pid_c_file.read_bytes()[:2000])
    for_windows(pid_c_file, folder / "windows.fmu")
    without(pid_c_file, folder / "sources.fmu", "binaries/")
    without(pid_c_file, folder / "uncompiled.fmu", "binaries/")
    with_broken_sources(pid_c_file, folder / "broken.fmu")
    without(pid_c_file, folder / "nothing.fmu", "binaries/", "sources/")
    of_another_guid(pid_c_file, folder / "guid.fmu")
    python_controller(
        folder,
        "Unlicensed",
        begin="self.log('no licence for Toolbox on host x', Fmi2Status.error); raise RuntimeError('no licence')",
        imports="from pythonfmu.enums import Fmi2Status",
    )
    python_controller(
        folder,
        "Uninitialized",
        initialize="self.log('gain table is empty', Fmi2Status.error); raise ValueError('gain table is empty')",
        imports="from pythonfmu.enums import Fmi2Status",
    )
    python_controller(
        folder,
        "OtherStep",
        step=0.001,
        step_body="assert abs(step_size - 0.001) < 1e-9, 'the step must be 1 ms'; self.law(); return True",
    )
    return folder


# ---- The file ----


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("absent.fmu", ["There is no file", "absent.fmu", "Give the path of an FMU"]),
        ("", ["There is no file", "Give the path"]),
        ("text.fmu", ["text.fmu is not an FMU: it is no zip archive"]),
        ("cut.fmu", ["cut.fmu is not an FMU: it is no zip archive"]),
        ("zip.fmu", ["zip.fmu is not an FMU: the archive has no modelDescription.xml"]),
        ("windows.fmu", ["no binary for this platform, linux64; it has win64", "Export it for linux64"]),
        ("nothing.fmu", ["no binary for this platform", "it has none"]),
        ("broken.fmu", ["The sources of broken.fmu do not compile", "\n  sources/pid.c:1:"]),
    ],
)
@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="the binaries are Linux's")
def test_files_that_are_no_usable_fmu(name, told, controllers, tmp_path):
    for _ in range(2):  # what a first attempt leaves in the cache does not change the answer
        message = refusal(tmp_path, *EVALUATE, controllers / name)
        assert all(words in message for words in told), message


def test_sources_are_compiled(controllers, tmp_path):
    finished = run("simulate", controllers / "sources.fmu", "--duration", "0.01", folder=tmp_path)
    assert finished.code == 0, finished.err
    assert "done at 0.01 s" in finished.out


def test_sources_without_a_compiler_are_told(controllers, tmp_path):
    (tmp_path / "bin").mkdir()
    changes = {"PATH": str(tmp_path / "bin"), "CC": ""}
    message = refusal(tmp_path, *EVALUATE, controllers / "uncompiled.fmu", changes=changes)
    assert "uncompiled.fmu comes as source code only, and there is no C compiler here" in message
    assert "Install one, or export the FMU with a binary" in message


# ---- Connectors ----


@pytest.mark.parametrize(
    ("name", "told"),
    [
        ("refused_missing_output", ["has no output u_m[1], u_m[2] [N.m]", "Nearest: y[1], y[2]", "--map u_m[1]=NAME"]),
        ("refused_two_candidates", ["more than one candidate for q_m", "--map q_m[1]="]),
        ("refused_three_axes", ["has 3 elements, but q_m needs 2"]),
        ("refused_wrong_unit", ["the unit 'm', which is no rad"]),
        ("refused_integer", ["declared as Integer"]),
    ],
)
def test_connectors_that_do_not_fit(name, told, exporter_folder, tmp_path):
    if REFUSED[name].missing():
        pytest.skip(REFUSED[name].missing())
    message = refusal(tmp_path, *EVALUATE, REFUSED[name].build(exporter_folder))
    assert all(words in message for words in told), message


def test_connectors_that_do_not_fit_simulate_either(exporter_folder, tmp_path):
    if REFUSED["refused_missing_output"].missing():
        pytest.skip(REFUSED["refused_missing_output"].missing())
    file = REFUSED["refused_missing_output"].build(exporter_folder)
    assert "has no output u_m[1]" in refusal(tmp_path, "simulate", file)


# ---- What the FMU itself refuses ----


@pytest.mark.parametrize(
    ("name", "options", "told"),
    [
        ("guid.fmu", (), ["guid.fmu: instantiation failed", "a GUID that is not the binary's", "the GUID is not {"]),
        ("Unlicensed.fmu", (), ["instantiation failed", "needs a tool to run: is PythonFMU", "no licence"]),
        ("Uninitialized.fmu", (), ["fmi2ExitInitializationMode failed", "gain table is empty"]),
        (
            "OtherStep.fmu",
            ("--sample-time", "0.00025"),
            ["The first sample fails", "fmi2DoStep", "the step must be 1 ms"],
        ),
    ],
)
def test_what_an_fmu_refuses_is_told_in_its_own_words(name, options, told, controllers, tmp_path):
    message = refusal(tmp_path, *EVALUATE, controllers / name, *options)
    assert all(words in message for words in told), message


def test_a_controller_of_another_sample_time_runs_at_its_own(controllers, tmp_path):
    finished = run("simulate", controllers / "OtherStep.fmu", "--duration", "0.02", folder=tmp_path)
    assert finished.code == 0, finished.err
    (table,) = tmp_path.rglob("trajectory.csv")
    assert len(table.read_text().splitlines()) == 1 + 21


# ---- Names and values ----


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--set", "K_q[1]=45"), ["has no parameter K_q[1]. Nearest:", "K_p[1]"]),
        (("--set", "q_m[1]=0"), ["q_m[1] is a Real input and cannot be set", "Nearest: "]),
        (("--set", "u_m0[1]=3"), ["u_m0[1] is the connector u_m0, which the benchmark gives its value"]),
        (("--map", "q_m[1]=a", "--map", "q_m[1]=b"), ["--map gives q_m[1] more than once"]),
        (("--set", "z_p[1]=1.5"), ["z_p[1] = 1.5", "0 <= z_p < 1"]),
        (("--map", "q_n[1]=x"), ["The mapping names q_n[1], which is no connector"]),
        (("--mapping", "absent.toml"), ["absent.toml cannot be read"]),
        (("--parameters", "absent.ssv"), ["absent.ssv cannot be read"]),
        (("--sample-time", "0.0004"), ["0.0004 s (given), no integer multiple or fraction"]),
        (("--plant-set", "m_3=1"), ["--plant-set", "no nominal parameter m_3"]),
        (("--plant-set", "m[1]=-1"), ["--plant-set: m[1] = -1 kg", "must be finite and > 0"]),
        (("--plant-set", "psi[1]=0"), ["--plant-set: psi[1] = 0 rad", "must be finite and > 0"]),
        (("--only", "c99.*"), ["No case matches --only c99.*"]),
        (("--set", "K_p[1]"), ["'K_p[1]' is not of the form NAME=NUMBER"]),
        (("--set", "K_p[1]=much"), ["is not of the form NAME=NUMBER"]),
        (("--map", "In1"), ["'In1' is not of the form CONNECTOR=VARIABLE"]),
        (("--jobs", "0"), ["at least 1 is needed"]),
        (("--jobs", "two"), ["'two' is no number of processes"]),
        (("--seed", "-1"), ["'-1' is no whole number from 0 on"]),
        (("--timeout", "soon"), ["'soon' is no finite number"]),
        (("--timeout", "1e300"), ["1e300 is above 1e+09"]),
        (("--sample-time", "soon"), ["'soon' is no time in seconds"]),
        (("--sample-time", "1e400"), ["'1e400' is no time in seconds"]),
        (("--sample-time", "1/0"), ["'1/0' is no time in seconds"]),
        (("--parameters", "huge.toml"), ["the value of K_p", "is no number"]),
        (("--protocol", "papper"), ["papper"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_names_and_values_that_do_not_fit(arguments, told, tmp_path):
    (tmp_path / "huge.toml").write_text(f'[parameters]\n"K_p[1]" = {"9" * 401}\n')
    message = refusal(tmp_path, *EVALUATE, *arguments)
    assert all(words in message for words in told), message


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (("--configuration", "0", "200"), ["200"]),
        (("--case", "c99.compliant.noise"), ["There is no case c99.compliant.noise"]),
        (("--case", "c01.compliant.nose"), ["nose"]),
        (("--system", "sticky_9"), ["sticky_9"]),
        (("--system", "random_0"), ["no system random_0"]),
        (("--case", "c01.compliant.noise", "--system", "sticky"), ["--case already says what --system would"]),
        (("--t-1", "5", "--t-2", "4"), ["would end at 4 s, before its start at 5 s"]),
        (("--t-3", "5", "--t-4", "4"), ["would end at 4 s, before its start at 5 s"]),
        (("--duration", "0"), ["0 s is no duration up to 1000 s"]),
        (("--duration", "1e9999999999"), ["'1e9999999999' is no time in seconds"]),
        (("--test", "nose"), ["nose"]),
        (("--plant-set", "alpha=-1", "--duration", "0.01"), ["alpha"]),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, tuple) else "",
)
def test_cases_that_do_not_exist(arguments, told, tmp_path):
    message = refusal(tmp_path, "simulate", *arguments)
    assert all(words in message for words in told), message


# ---- Where to write ----


def test_a_folder_that_cannot_be_locked_is_told(tmp_path):
    (tmp_path / "out" / ".lock").mkdir(parents=True)
    assert "cannot be locked" in refusal(tmp_path, *EVALUATE, "--output-dir", "out")


@pytest.mark.skipif(os.name != "posix", reason="a file system without device files")
@pytest.mark.parametrize("module", ["evaluate", "simulate"])
@pytest.mark.parametrize("target", ["taken", "taken/below", "/dev/null/x", "/proc/nowhere"])
def test_an_unwritable_output_folder_is_told_before_anything_runs(module, target, tmp_path):
    (tmp_path / "taken").write_text("a file")
    begin = time.perf_counter()
    message = refusal(tmp_path, module, "--output-dir", target)
    assert target in message
    assert time.perf_counter() - begin < 60


# ---- Ctrl-C ----


def interrupted(folder: Path, *arguments: object, ready) -> tuple[int, str, str]:
    """Exit code and output of a command that gets SIGINT, as from a terminal, once ``ready()``."""
    process = subprocess.Popen(
        command(*arguments),
        cwd=folder,
        env=environment(),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    deadline = time.monotonic() + 120
    while not ready() and time.monotonic() < deadline and process.poll() is None:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGINT)
    out, err = process.communicate(timeout=60)
    return process.returncode, out, err


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_stops_an_evaluation_and_leaves_no_result(tmp_path):
    output = tmp_path / "out"
    code, out, err = interrupted(
        tmp_path, "evaluate", "--jobs", "2", "--output-dir", output, ready=lambda: _stored(output)
    )
    assert code == 130 and out == ""
    assert err.rstrip().endswith("interrupted") and "Traceback" not in err
    assert not (output / "results.json").exists() and not (output / "cases.csv").exists()


def _stored(folder: Path) -> bool:
    """Whether an evaluation has begun to write."""
    return any(file.stat().st_size > 0 for file in folder.glob("*")) if folder.is_dir() else False


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
def test_ctrl_c_stops_a_simulation(tmp_path):
    output = tmp_path / "out"
    code, out, err = interrupted(
        tmp_path, "simulate", "--duration", "1000", "--output-dir", output, ready=lambda: output.is_dir()
    )
    assert code == 130 and out == ""
    assert err.rstrip().endswith("interrupted") and "Traceback" not in err
    assert not list(output.glob("*"))


@pytest.mark.skipif(os.name != "posix", reason="signals of POSIX")
@pytest.mark.parametrize("patience", [0.3, 0.8, 1.5, 2.5])
def test_ctrl_c_at_any_time_is_told_in_a_word(patience, tmp_path):
    """While modules are imported, while the fork server starts, while code is compiled: no traceback."""
    due = time.monotonic() + patience
    code, _, err = interrupted(
        tmp_path, "evaluate", "--quick", "--output-dir", tmp_path, ready=lambda: time.monotonic() > due
    )
    assert code in (130, -signal.SIGINT)
    assert "Traceback" not in err and err.rstrip().endswith("interrupted")
    assert not (tmp_path / "results.json").exists()
