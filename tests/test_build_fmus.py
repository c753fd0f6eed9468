"""The build: FMUs that validate strictly, say all about themselves, and come out byte for byte the same."""

import json
import re
import sys
import zipfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from fmpy import read_model_description
from fmpy.validation import validate_fmu
from support.pid_fmus import built
from support.refusals import refusal
from support.tools import in_c, require_for

import build_fmus
from controller_fmu import errors
from controller_fmu.export import Dialect, build_folder, python_fmu
from controller_fmu.export.units import base_exponents

PID = Path(build_fmus.__file__).parent / "controller_fmu" / "pid_c"

SLAVE = """
from pythonfmu import Fmi2Causality, Fmi2Slave, Real
{tables}
class Probe(Fmi2Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.torque = 0.0
        self.register_variable(Real("torque", causality=Fmi2Causality.output))
    def do_step(self, current_time, step_size):
        return True
"""


@pytest.mark.parametrize("name", build_fmus.NAMES + build_fmus.PLANT_VARIANTS + build_fmus.VARIANTS)
def test_fmus_are_valid_say_whose_and_what_they_are_and_come_out_the_same(name, fmu_folder, tmp_path):
    require_for(name)
    fmu = built(name, fmu_folder)
    assert validate_fmu(str(fmu)) == []
    assert build_fmus.build(name, tmp_path).read_bytes() == fmu.read_bytes()
    description = read_model_description(str(fmu))
    assert description.modelName == name
    assert all((description.author, description.version, description.description, description.generationTool))
    assert description.generationDateAndTime is None
    declared = [v for v in description.modelVariables if v.causality != "independent"]
    assert [v.name for v in declared if not v.unit or not v.description] == []
    if description.fmiVersion != "1.0":
        assert description.license == "MIT" and description.defaultExperiment.stepSize
        computed = {v.name for v in declared if v.causality in ("output", "calculatedParameter", "local")}
        assert {unknown.variable.name for unknown in description.initialUnknowns} == computed
    with zipfile.ZipFile(fmu) as archive:
        entries = {entry.filename: entry.date_time for entry in archive.infolist()}
    assert [entry for entry in entries if "__pycache__" in entry] == []
    assert set(entries.values()) == {(1980, 1, 1, 0, 0, 0)}
    if not in_c(name):
        assert {f"binaries/linux64/{name}.so", f"binaries/win64/{name}.dll"} <= set(entries)


def test_builds_at_once_do_not_disturb_each_other_and_import_no_slave(tmp_path):
    path = list(sys.path)
    with ThreadPoolExecutor(3) as pool:
        built = list(pool.map(lambda _: build_fmus.build("DiagonalPID", tmp_path).read_bytes(), range(3)))
    assert len(set(built)) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["DiagonalPID.fmu"]
    assert sys.path == path and "diagonal_pid_fmu" not in sys.modules


@pytest.mark.parametrize(
    ("unit", "exponents"),
    [
        ("1", {}),
        ("N.m/(rad.s)", {"kg": 1, "m": 2, "s": -3, "rad": -1}),
        ("1/s", {"s": -1}),
        ("A.s/mol", {"s": 1, "A": 1, "mol": -1}),
        ("m/m", {}),
    ],
)
def test_units_are_taken_apart(unit, exponents):
    assert base_exponents(unit) == exponents


@pytest.mark.parametrize(("unit", "nearest"), [("Nm", "N.m"), ("furlong/s", None), ("rad^2", "rad"), ("", None)])
def test_unknown_units_are_refused(unit, nearest):
    error = refusal(base_exponents, unit, kind=errors.UnitError)
    assert error.value == unit and next(iter(error.nearest), None) == nearest


@pytest.mark.parametrize(
    ("tables", "value", "nearest"),
    [
        ("", "torque", ()),
        ("UNITS = {'torques': 'N.m'}", "torque", ("torques",)),
        ("UNITS = {'torque': 'ozf.in'}", "ozf.in", ()),
        ("UNITS = {'torque': 'inlb'}; BASE_UNITS = {'inlb': {'kgs': 1}}", "kgs", ("kg",)),
        ("UNITS = {'torque': 'x'}; BASE_UNITS = {'x': {'kg': 1, 'm': 2, 's': -2, 'factor': 0.007}}", None, ()),
    ],
)
def test_units_of_a_slave_in_python(tables, value, nearest, tmp_path):
    script, fmu = tmp_path / "probe_slave.py", tmp_path / "Probe.fmu"
    script.write_text(SLAVE.format(tables=tables))
    if value is None:
        build_folder(tmp_path, fmu)
        (own,) = (unit.baseUnit for unit in read_model_description(str(fmu)).unitDefinitions if unit.name == "x")
        assert (own.kg, own.m, own.s, own.factor) == (1, 2, -2, 0.007)
        return
    error = refusal(build_folder, tmp_path, fmu, kind=errors.UnitError)
    assert (error.where, error.value) == (str(script), value) and set(nearest) <= set(error.nearest)
    assert "UNITS" in error.remedy or nearest
    assert not fmu.exists()


@pytest.mark.parametrize("script", ["missing_fmu.py", "broken_fmu.py"])
def test_scripts_that_cannot_be_built_are_named(script, tmp_path):
    (tmp_path / "broken_fmu.py").write_text("raise RuntimeError('out of ink')")
    arguments = tmp_path / script, [], script.removesuffix(".py"), tmp_path / "probe.fmu"
    error = refusal(python_fmu, *arguments, kind=errors.SourceError)
    assert error.where == str(tmp_path / script)
    assert ("out of ink" in error.what) == (script == "broken_fmu.py")


def exported(folder, *changes, dialect=None):
    """The FMU of the PID in C, whose files have gone through replacements of old by new by regular expressions."""
    sources = folder / "sources"
    sources.mkdir()
    texts = {file.name: file.read_text() for file in PID.iterdir()}
    for file, old, new in changes:
        texts[file], count = re.subn(old, new, texts[file], flags=re.DOTALL)
        assert count, old
    for name, text in texts.items():
        (sources / name).write_text(text)
    return build_folder(sources, folder / "Mine.fmu", dialect)


XML, MODEL = "modelDescription.xml", "model.c"


DEG = '<UnitDefinitions><Unit name="deg"><BaseUnit rad="1" factor="0.0174532925199433"/></Unit></UnitDefinitions>'


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("version", [1, 2, 3])
def test_what_a_description_may_leave_out_and_define(version, tmp_path):
    changes = (XML, "<LogCategories>.*?</LogCategories>", DEG), (XML, "<DefaultExperiment[^>]*>", "")
    fmu = exported(tmp_path, *changes, (XML, 'unit="rad"', 'unit="deg"'), dialect=Dialect(version))
    description = read_model_description(str(fmu))
    assert len(description.modelVariables) >= 17
    if version > 1:
        assert validate_fmu(str(fmu)) == []
        definitions = {unit.name: unit.baseUnit for unit in description.unitDefinitions}
        assert definitions["deg"].factor == 0.0174532925199433 and definitions["N.m"].kg == 1


REFERENCE, BAD_XML, ARRAYS = errors.ValueReferenceError, errors.DescriptionError, Dialect(3, arrays=True)


BAD_MODELS = [
    ((XML, "<LogCategories>", "<LogCategories"), None, BAD_XML, "", ()),
    ((XML, "ModelStructure>", "Structure>"), None, BAD_XML, "ModelStructure", ()),
    ((XML, ' unit="N.m/rad"', ""), None, errors.UnitError, "K_p[1]", ()),
    ((XML, 'unit="s"', 'unit="ms"'), None, errors.UnitError, "ms", ("m", "s")),
    ((XML, 'start="45"', 'start="high"'), None, BAD_XML, "high", ()),
    ((XML, 'Reference="6"', 'Reference="five"'), None, REFERENCE, "five", ()),
    ((XML, 'Reference="6"', 'Reference="7"'), None, REFERENCE, "7", ()),
    ((XML, 'Reference="16"', 'Reference="99"'), None, REFERENCE, "99", ("16",)),
    ((XML, 'start="45"', 'start="46"'), None, REFERENCE, "6", ()),
    ((MODEL, "double u_m0.AXES.;", "double u_m0[AXES], extra;"), None, REFERENCE, "17", ()),
    ((XML, 'index="6"', 'index="66"'), Dialect(3), BAD_XML, "66", ()),
    ((XML, "</Outputs>", '</Outputs><Derivatives><Unknown index="6"/></Derivatives>'), None, BAD_XML, "6", ()),
    ((XML, ' start="45"', ""), ARRAYS, BAD_XML, "K_p", ()),
    ((XML, '<Real unit="N.m/rad" start="45"/>', ""), Dialect(1), BAD_XML, "Real", ()),
    ((XML, r'name="(q_m|u_m)\[2\]', lambda m: f'name="{"qu"[m[1] == "q_m"]}_m[2]'), ARRAYS, REFERENCE, "2", ()),
    ((MODEL, r"pid->T_s = 0.25e-3;", "*(volatile int *)0 = 0;"), None, errors.CompilerError, "", ()),
    ((MODEL, "#include <math.h>", "#error out of ink"), None, errors.CompilerError, None, ()),
]


@pytest.mark.needs("compiler")
@pytest.mark.parametrize(("change", "dialect", "error", "value", "nearest"), BAD_MODELS)
def test_models_that_cannot_be_used(change, dialect, error, value, nearest, tmp_path):
    refused = refusal(exported, tmp_path, change, dialect=dialect, kind=error)
    assert type(refused) is error and (refused.value == value or value is None)
    assert set(nearest) <= set(refused.nearest)
    assert refused.where in (str(tmp_path / "sources" / XML), str(tmp_path / "Mine.fmu"))
    assert not (tmp_path / "Mine.fmu").exists()


def test_without_compiler_c_is_skipped_with_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setenv("CC", "no-such-compiler")
    assert build_fmus.main(["DiagonalPID", "--output-dir", str(tmp_path)]) == 0
    monkeypatch.setattr(build_fmus, "NAMES", ("DiagonalPID_C",))
    assert build_fmus.main(["--output-dir", str(tmp_path)]) == 0
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert build_fmus.main(["DiagonalPID_C", "--output-dir", str(tmp_path)]) == 1
    assert [file.name for file in tmp_path.iterdir()] == ["DiagonalPID.fmu"]


@pytest.mark.slow
@pytest.mark.needs("compiler", "ziglang")
def test_the_module_for_the_web_is_small_needs_nothing_and_comes_out_the_same(tmp_path, capsys):
    assert build_fmus.main(["--web", "--output-dir", str(tmp_path)]) == 0
    files = module, meaning, _ = [tmp_path / name for name in build_fmus.WEB_FILES]
    assert capsys.readouterr().out.split() == [str(file) for file in files]
    code = module.read_bytes()
    assert code[:4] == b"\0asm" and len(code) <= 200_000
    assert 2 not in sections(code)  # that of imports
    told = json.loads(meaning.read_text(encoding="utf-8"))
    assert {"FlexibleManipulatorNative", "Imperfections", "DiagonalPID_C", "RobustLQG", "Linear_8"} <= {
        unit["name"] for unit in told["units"]
    }
    build_fmus.build_web(tmp_path)
    assert module.read_bytes() == code


def sections(code):
    """The kinds of the sections of a module of WebAssembly."""
    found, at = [], 8
    while at < len(code):
        found.append(code[at])
        size, shift, at = 0, 0, at + 1
        while True:
            byte, at = code[at], at + 1
            size, shift = size | (byte & 0x7F) << shift, shift + 7
            if byte < 0x80:
                break
        at += size
    return found


@pytest.mark.needs("compiler")
def test_without_its_compiler_the_module_is_skipped_with_one_line(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr("controller_fmu.export.one_program.find_spec", lambda name: None)
    assert build_fmus.main(["--web", "--output-dir", str(tmp_path)]) == 1
    said = capsys.readouterr().err
    assert said.startswith("skipped ") and "ziglang" in said and not list(tmp_path.iterdir())


def test_wrong_names_and_kinds_are_refused(tmp_path):
    error = refusal(build_fmus.build, "DiagonalPDI", tmp_path, kind=build_fmus.UnknownFmuError)
    assert error.value == "DiagonalPDI" and "DiagonalPID" in error.nearest
    assert build_fmus.main(["DiagonalPDI", "DiagonalPID", "--output-dir", str(tmp_path)]) == 2
    assert list(tmp_path.iterdir()) == [], "nothing is built if the input is bad"
    for wrong in ((2, "CoSimulation", True), (1, "ModelExchange"), (2, "CoSimulation", False, 32)):
        assert refusal(Dialect, *wrong, kind=errors.DialectError).value in ("arrays", "ModelExchange", "Float32")


@pytest.mark.needs("compiler")
def test_a_source_that_hides_one_that_is_added_is_refused(tmp_path):
    (tmp_path / "component.c").write_text("")
    arguments = [tmp_path / "component.c"], PID / XML, tmp_path / "X.fmu"
    assert refusal(build_fmus.c_fmu, *arguments, kind=errors.SourceError).value == "component.c"


@pytest.mark.parametrize("name", ["DiagonalPID", "DiagonalPID_C"])
def test_no_folder_is_made_to_write_to(name, tmp_path, capsys):
    target = tmp_path / "not" / "there"
    assert refusal(build_fmus.build, name, target, kind=errors.TargetError).value == str(target)
    assert build_fmus.main(["--output-dir", str(tmp_path / "not")]) == 2
    assert list(tmp_path.iterdir()) == [] and len(capsys.readouterr().err.splitlines()) == 1
