"""The build: FMUs that validate strictly, say all about themselves, and come out byte for byte the same."""

from __future__ import annotations

import re
import subprocess
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu

import build_fmus
from controller_fmu.export.__main__ import main as export
from controller_fmu.export.units import base_exponents

SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real
{units}
class Probe(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.torque = 0.0
        self.register_variable(Real("torque", causality=Fmi2Causality.output))
    def do_step(self, current_time, step_size):
        return True
"""


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("fmus")


@pytest.fixture(scope="module", params=build_fmus.NAMES)
def fmu(request, folder):
    if request.param.endswith("_C") and build_fmus.find_compiler() is None:
        pytest.skip("no C compiler")
    return build_fmus.build(request.param, folder)


def test_strict_validation_finds_nothing(fmu):
    assert validate_fmu(str(fmu)) == []


def test_every_variable_has_a_unit_and_a_description(fmu):
    variables = read_model_description(str(fmu)).modelVariables
    assert [v.name for v in variables if not v.unit or not v.description] == []


def test_description_says_whose_and_what(fmu):
    description = read_model_description(str(fmu))
    assert description.modelName == fmu.stem
    assert description.license == "MIT"
    assert all((description.author, description.version, description.description))
    assert description.defaultExperiment.stepSize
    assert description.generationDateAndTime is None
    outputs = {v.name for v in description.modelVariables if v.causality in ("output", "calculatedParameter")}
    assert {unknown.variable.name for unknown in description.initialUnknowns} == outputs


def test_equal_sources_give_equal_bytes(fmu, tmp_path):
    assert build_fmus.build(fmu.stem, tmp_path).read_bytes() == fmu.read_bytes()


def test_archive_holds_no_leftovers(fmu):
    with zipfile.ZipFile(fmu) as archive:
        entries = archive.infolist()
    assert [entry.filename for entry in entries if "__pycache__" in entry.filename] == []
    assert {entry.date_time for entry in entries} == {(1980, 1, 1, 0, 0, 0)}
    if not fmu.stem.endswith("_C"):
        libraries = {f"binaries/linux64/{fmu.stem}.so", f"binaries/win64/{fmu.stem}.dll"}
        assert libraries <= {entry.filename for entry in entries}


def test_builds_at_once_do_not_disturb_each_other(tmp_path):
    with ThreadPoolExecutor(4) as pool:
        built = list(pool.map(lambda _: build_fmus.build("DiagonalPID", tmp_path).read_bytes(), range(4)))
    assert len(set(built)) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["DiagonalPID.fmu"]


def test_building_imports_no_slave_code(tmp_path):
    path = list(sys.path)
    build_fmus.build("DiagonalPID", tmp_path)
    assert sys.path == path
    assert "diagonal_pid_fmu" not in sys.modules


# ---- What can go wrong ----


def test_missing_unit_is_named(tmp_path):
    script = tmp_path / "probe_slave.py"
    script.write_text(SLAVE.format(units="UNITS = {}"))
    with pytest.raises(build_fmus.BuildError, match="Probe: variable 'torque' has no unit; add 'torque'"):
        build_fmus.python_fmu(script, [], "probe_slave", tmp_path / "probe.fmu")
    assert not (tmp_path / "probe.fmu").exists()


def test_missing_units_and_missing_script_are_reported(tmp_path):
    script = tmp_path / "unitless_slave.py"
    with pytest.raises(build_fmus.BuildError, match=r"unitless_slave\.py does not exist"):
        build_fmus.python_fmu(script, [], "unitless_slave", tmp_path / "probe.fmu")
    script.write_text(SLAVE.format(units=""))
    with pytest.raises(build_fmus.BuildError, match="has unitless_slave a dict UNITS"):
        build_fmus.python_fmu(script, [], "unitless_slave", tmp_path / "probe.fmu")


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("N.m/(rad.s)", {"kg": 1, "m": 2, "s": -3, "rad": -1}),
        ("kg.m2", {"kg": 1, "m": 2}),
        ("m/s2", {"m": 1, "s": -2}),
        ("s/rad", {"s": 1, "rad": -1}),
        ("1/s", {"s": -1}),
        ("m/m", {}),
    ],
)
def test_units_are_taken_apart(unit, exponents):
    assert base_exponents(unit) == exponents


@pytest.mark.parametrize("unit", ["Nm", "furlong/s", "m^2", "m-1"])
def test_unknown_units_are_refused(unit):
    with pytest.raises(build_fmus.BuildError, match="spell the unit with"):
        base_exponents(unit)


def test_unit_without_spelling_is_refused():
    with pytest.raises(build_fmus.BuildError, match="unit ''"):
        base_exponents("")


# ---- Models in C ----

PID = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"
in_c = pytest.mark.skipif(build_fmus.find_compiler() is None, reason="no C compiler")


def exported(folder, change, *options):
    """Exit code of the export of the PID in C, whose description has gone through ``change``; and the FMU."""
    sources = folder / "sources"
    sources.mkdir()
    for file in PID.glob("*.[ch]"):
        (sources / file.name).write_bytes(file.read_bytes())
    (sources / "modelDescription.xml").write_text(change((PID / "modelDescription.xml").read_text()))
    return export([*options, str(sources), str(folder / "Mine.fmu")]), folder / "Mine.fmu"


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (["--arrays"], "FMI 2 has no arrays; build for FMI 3 (--fmi 3), or without arrays"),
        (["--fmi", "1", "--arrays"], "FMI 1 has no arrays"),
        (["--fmi", "1", "--model-exchange"], "FMI 1 is for co-simulation here"),
    ],
)
def test_kinds_of_fmu_that_do_not_exist_are_refused(options, told, tmp_path, capsys):
    code, fmu = exported(tmp_path, str, *options)
    assert code == 2 and told in capsys.readouterr().err and not fmu.exists()


def test_single_precision_is_for_fmi_3():
    with pytest.raises(build_fmus.BuildError, match="FMI 2 has no Float32; build for FMI 3"):
        build_fmus.Dialect(2, float_bits=32)


@in_c
@pytest.mark.parametrize("version", ["1", "2", "3"])
def test_what_a_description_may_leave_out(version, tmp_path):
    def change(text):
        text = re.sub(r"<LogCategories>.*?</LogCategories>", "", text, flags=re.DOTALL)
        return re.sub(r"<DefaultExperiment[^>]*>", "", text)

    code, fmu = exported(tmp_path, change, "--fmi", version)
    assert code == 0 and len(read_model_description(str(fmu)).modelVariables) >= 17


@in_c
@pytest.mark.parametrize("version", ["1", "2", "3"])
@pytest.mark.parametrize(
    ("old", "new", "told"),
    [
        ("<LogCategories>", "<LogCategories", "the model description is no well-formed XML"),
        ("ModelStructure>", "Structure>", "has no ModelStructure"),
    ],
)
def test_descriptions_that_cannot_be_used_are_told(version, old, new, told, tmp_path, capsys):
    code, fmu = exported(tmp_path, lambda text: text.replace(old, new), "--fmi", version)
    assert code == 1 and told in capsys.readouterr().err and not fmu.exists()


# ---- The command line ----


def test_without_compiler_c_is_skipped_with_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("PATH", "")
    monkeypatch.delenv("CC", raising=False)
    assert build_fmus.main(["--output-dir", str(tmp_path)]) == 0
    printed = capsys.readouterr()
    assert printed.err.splitlines() == [
        "skipped DiagonalPID_C.fmu: no C compiler found (cc, gcc, clang, or set CC); install one"
    ]
    assert [Path(line).stem for line in printed.out.splitlines()] == [
        name for name in build_fmus.NAMES if name != "DiagonalPID_C"
    ]
    assert build_fmus.main(["DiagonalPID_C", "--output-dir", str(tmp_path)]) == 1


def test_cc_is_honoured(monkeypatch):
    monkeypatch.setenv("CC", "no-such-compiler -m64")
    assert build_fmus.find_compiler() is None
    monkeypatch.setenv("CC", f"'{sys.executable}' -m cc")
    assert build_fmus.find_compiler() == [sys.executable, "-m", "cc"]


def test_failing_compiler_is_reported(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CC", f"'{sys.executable}' -c 'raise SystemExit(\"out of ink\")'")
    assert build_fmus.main(["DiagonalPID_C", "--output-dir", str(tmp_path)]) == 1
    assert "out of ink" in capsys.readouterr().err


def test_wrong_name_gets_the_nearest_ones(tmp_path, capsys):
    assert build_fmus.main(["DiagonalPDI", "DiagonalPID", "--output-dir", str(tmp_path)]) == 2
    assert "no FMU is named 'DiagonalPDI'; did you mean DiagonalPID" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == [], "nothing is built where the input is bad"


def test_output_folder_that_is_a_file_is_reported(tmp_path, capsys):
    file = tmp_path / "file"
    file.write_text("")
    assert build_fmus.main(["DiagonalPID", "--output-dir", str(file)]) == 2
    assert f"{file} cannot be made a folder" in capsys.readouterr().err


def test_runs_as_a_script_from_anywhere(tmp_path):
    command = [sys.executable, build_fmus.__file__, "DiagonalPID"]
    finished = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=True)
    assert finished.stdout.strip() == str(Path("build", "fmus", "DiagonalPID.fmu"))
    assert (tmp_path / "build" / "fmus" / "DiagonalPID.fmu").is_file()
