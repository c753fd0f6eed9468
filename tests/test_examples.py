"""The starter kits: copied under another name they build as their READMEs say, and are the benchmark's PID."""

import json
import re
import shlex
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu
from numpy.testing import assert_allclose
from support.command_lines import call
from support.pid_fmus import GAINS, fmpys_torques, in_child, law, random_signals
from support.refusals import refusal

from controller_fmu import errors, starters
from controller_fmu.export import Dialect, build_folder, unpack
from controller_fmu.export.__main__ import main as export

KINDS = [
    *("python", "numpy"),
    pytest.param("c", marks=pytest.mark.needs("compiler")),
    pytest.param("onnx", marks=pytest.mark.needs("onnxruntime")),
]


@pytest.mark.parametrize("kind", KINDS)
def test_commands_of_the_readme_build_the_pid(kind, tmp_path, monkeypatch):
    """With units everywhere, and the torques of eq. (13): to the last bit with gains to tune, else up to rounding."""
    folder = starters.copy(kind, tmp_path / "fast_arm")
    assert not [file for file in folder.iterdir() if "controller" in file.name]
    monkeypatch.chdir(folder)
    block = re.search(r"^```sh\n(.*?)^```", Path("README.md").read_text(), re.DOTALL | re.MULTILINE)
    for command in block[1].splitlines():
        interpreter, option, module, *arguments = shlex.split(command)
        assert (interpreter, option, module) == ("python", "-m", "controller_fmu.export")
        assert export(arguments) == 0
    built = sorted(folder.glob("*.fmu"))
    assert [file.stem for file in built] == (["FastArm", "FastArm3"] if kind == "c" else ["FastArm"])
    signals = random_signals(20)
    expected, has_gains = [[signals.u_m0, *law(signals)]] * len(built), kind in ("python", "c")
    assert_allclose(in_child(fmpys_torques, built, signals), expected, rtol=0.0, atol=0.0 if has_gains else 1e-9)
    for file in built:
        assert validate_fmu(str(file)) == []
    variables = {v.name: v for v in read_model_description(str(built[0])).modelVariables}
    assert all(v.unit for v in variables.values() if v.type in ("Real", "Float64"))
    for name, values in GAINS.items():
        starts = [float(variables[f"{name}[{i}]"].start) for i in (1, 2) if f"{name}[{i}]" in variables]
        assert starts == (list(values) if has_gains and name != "z_p" else [])


SWITCHES = {"integrator": False, "derivative_filter": 1, "derivative_samples": 4}
"""Values of a Boolean, an enumeration and an integer, as results have them."""

FILES = {
    "switches.txt": "integrator = false\nderivative_filter = none\nderivative_samples = 4\n",
    "switches.json": '{"integrator": false, "derivative_filter": "none", "derivative_samples": 4}',
    "switches.toml": '[parameters]\nintegrator = false\nderivative_filter = "none"\nderivative_samples = 4\n',
    "switches.ssv": """<ssv:ParameterSet version="1.0" name="switches"
        xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues"><ssv:Parameters>
        <ssv:Parameter name="integrator"><ssv:Boolean value="false"/></ssv:Parameter>
        <ssv:Parameter name="derivative_filter"><ssv:Enumeration value="none"/></ssv:Parameter>
        <ssv:Parameter name="derivative_samples"><ssv:Integer value="4"/></ssv:Parameter>
        </ssv:Parameters></ssv:ParameterSet>""",
}


@pytest.fixture(scope="module")
def python_kit(tmp_path_factory):
    """The FMU of the Python kit."""
    return build_folder(starters.copy("python", tmp_path_factory.mktemp("kit") / "fast_arm"))


def test_the_switches_of_the_python_kit_do_what_they_say(python_kit):
    assert validate_fmu(str(python_kit)) == []
    signals = random_signals(20)
    gains = {**GAINS, "K_i": (0.0, 0.0), "z_p": (0.0, 0.0)}
    (torques,) = in_child(fmpys_torques, [python_kit], signals, **SWITCHES)
    assert torques == [signals.u_m0, *law(signals, gains, samples=4)] != [signals.u_m0, *law(signals)]


def test_parameters_of_every_type_come_from_every_file_and_are_recorded(python_kit, tmp_path):
    given = {"--set": [word for name, value in SWITCHES.items() for word in ("--set", f"{name}={value!s}".lower())]}
    for name, contents in FILES.items():
        (tmp_path / name).write_text(contents)
        given[name] = ["--parameters", name]
    case = ("--quick", "--only", "c00.compliant.noise", "--no-report", "--output-dir", "own", "--json")
    found = {}
    for way, words in given.items():
        done = call("evaluate", python_kit, *words, *case, folder=tmp_path)
        found[way] = json.loads(done.out)
        recorded = found[way]["head"]["controller"]["parameters"]
        assert recorded == SWITCHES and [*map(type, recorded.values())] == [bool, int, int], (way, done.err)
    assert len({json.dumps(each["cases"]) for each in found.values()}) == 1
    simulated = call("simulate", python_kit, *given["switches.ssv"], "--duration", "0.1", folder=tmp_path)
    assert simulated.code == 0, simulated.err


def test_an_enumeration_that_is_no_integer_variable_is_refused(tmp_path):
    folder = starters.copy("python", tmp_path / "fast_arm")
    script = folder / "fast_arm_fmu.py"
    script.write_text(script.read_text().replace('{"derivative_filter": (', '{"derivative_filtre": ('))
    error = refusal(build_folder, folder, kind=errors.DescriptionError)
    assert error.value == "derivative_filtre" and list(error.nearest) == ["derivative_filter", "derivative_samples"]


REFUSED = [
    *(("pyhton", "fast_arm", errors.UnknownKitError, "python"), ("rust", "fast_arm", errors.UnknownKitError, "c")),
    *(("c", "fast-arm", errors.ModelNameError, "fast_arm"), ("c", "2nd", errors.ModelNameError, "nd")),
    ("c", "component", errors.ModelNameError, "component_controller"),
    *(("python", name, errors.ModelNameError, f"{name}_controller") for name in ("axis", "none")),
    *(("c", name, errors.FolderTakenError, None) for name in ("taken", "file", "nowhere/fast_arm")),
]


@pytest.mark.parametrize(("kind", "name", "error", "nearest"), REFUSED)
def test_copies_that_cannot_be_made(kind, name, error, nearest, tmp_path):
    (tmp_path / "taken").mkdir()
    for file in ("taken/mine.c", "file"):
        (tmp_path / file).write_text("mine")
    before = sorted(tmp_path.rglob("*"))
    refused = refusal(starters.copy, kind, tmp_path / name, kind=error)
    assert nearest is None or nearest in refused.nearest
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("slaves", [[], ["one_fmu.py", "two_fmu.py"]])
def test_a_folder_must_hold_one_controller(slaves, tmp_path):
    for name in ["notes.py", *slaves]:
        (tmp_path / name).write_text("")
    error = refusal(build_folder, tmp_path, kind=errors.SourceError)
    assert error.where == str(tmp_path) and list(error.nearest) == slaves
    assert export([str(tmp_path)]) == 2


def test_what_lies_beside_a_slave_travels_with_it(tmp_path):
    (tmp_path / "fast_arm").mkdir()  # an empty folder may be there
    folder = starters.copy("python", tmp_path / "fast_arm")
    script = folder / "fast_arm_fmu.py"
    script.write_text("import fast_arm_filters, fast_arm_package\n" + script.read_text())
    (folder / "fast_arm_package").mkdir()
    for name in ("fast_arm_filters.py", "fast_arm_package/__init__.py", "gains.json", "plot.png"):
        (folder / name).write_text("")
    with pytest.raises(errors.DialectError):
        build_folder(folder, dialect=Dialect(3))
    build_folder(folder, tmp_path / "Arm.fmu")
    resources = {path.removeprefix("resources/") for path in unpack(tmp_path / "Arm.fmu")}
    assert {"fast_arm_filters.py", "fast_arm_package/__init__.py", "gains.json"} <= resources
    assert "plot.png" not in resources
