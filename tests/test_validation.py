"""The findings on a description: those of FMPy's validation, in a time and a number of lines that have an end."""

import shutil
import zipfile

import pytest
from fmpy.model_description import ModelDescription, ModelVariable
from fmpy.validation import _validate_variable_names
from hostile import fmus
from hostile.fmus import Fault, hostile_fmu
from hypothesis import given, settings
from hypothesis import strategies as st

from controller_fmu.export.archive import pack
from orchestrator import Benchmark, Controller
from orchestrator.conformance import static as validation
from orchestrator.conformance.static import (
    MAX_KINDS,
    MAX_PER_KIND,
    MAX_PROBLEM_LENGTH,
    STRUCTURED,
    summed_up,
    validation_problems,
)
from orchestrator.fmi import connectors
from orchestrator.fmi.description import read_description

VARIABLE = b'<ScalarVariable name="%s" valueReference="%d" causality="local" variability="continuous"><Real/>%s\n'
END = b"</ScalarVariable>"

PARTS = ("a", "_b1", "der(", ")", "[1]", "[1,20]", "[", "]", ".", ",2", ",", "'q.[ ]'", "'", "\\n", " ", "1", "ä", "")


def illegal(tried: list[str]) -> set[str]:
    """What FMPy's own parser refuses."""
    every = [ModelVariable(name=name, valueReference=0) for name in tried]
    problems = _validate_variable_names(ModelDescription(modelVariables=every, variableNamingConvention="structured"))
    return {name for name in tried if any(problem.startswith(f'"{name}" (line') for problem in problems)}


@settings(max_examples=20, deadline=None)
@given(st.lists(st.lists(st.sampled_from(PARTS), max_size=6).map("".join), min_size=20, max_size=40))
def test_structured_names_are_those_of_the_grammar(tried):
    assert {name for name in tried if not STRUCTURED.fullmatch(name)} == illegal(tried)


@pytest.mark.parametrize(
    "name", ["'" + "\\'" * 5000, "a." * 5000, "a[" + "1," * 5000, "der(" * 5000, "a" * 50_000 + " "]
)
def test_a_long_name_is_looked_through_once(name):
    assert not STRUCTURED.fullmatch(name)


def with_variables(count: int, name: str = "plant.block[%d].gain"):
    """The files of an FMU with ``count`` more variables, whose names follow the structured convention."""
    files = fmus.sound()
    added = b"".join(VARIABLE % ((name % i).encode(), 10_000 + i, END) for i in range(count))
    described = files["modelDescription.xml"].replace(b"</ModelVariables>", added + b"</ModelVariables>")
    assert b'variableNamingConvention="structured"' in described
    return {**files, "modelDescription.xml": described}


def test_names_are_not_parsed_by_a_grammar_nor_spelled_at_each_binding(tmp_path, monkeypatch):
    """FMPy's grammar took 5 ms for each name, and each instance of a controller is bound."""
    monkeypatch.setattr("lark.Lark", None)
    spelled, spelling = [], connectors.spelling
    monkeypatch.setattr(connectors, "spelling", lambda *given: spelled.append(given) or spelling(*given))
    file = tmp_path / "many.fmu"
    file.write_bytes(pack(with_variables(2000)))
    description = read_description(file)
    assert validation_problems(file, description) == []
    for _ in range(5):
        assert set(connectors.bind_controller(description, "it")) > {"q_m", "u_m"}
    bindable = [variable for variable in description.modelVariables if variable.causality != "local"]
    assert len(spelled) == len(bindable) < 20


def test_problems_of_one_kind_are_one_finding(tmp_path):
    file = tmp_path / "many.fmu"
    file.write_bytes(pack(with_variables(5000, "block %d")))
    (text,) = summed_up(validation_problems(file, read_description(file)))
    lines = text.splitlines()
    assert lines[:2] == [
        f'"block {i}" is not a legal variable name for the naming convention "structured".' for i in (0, 1)
    ]
    assert (len(lines), lines[-1]) == (MAX_PER_KIND + 1, f"and {5000 - MAX_PER_KIND} more of this kind")


@given(st.lists(st.text("ab 01\"'", max_size=30) | st.just("x" * 3000), max_size=60))
def test_no_problem_is_lost_and_few_are_shown(problems):
    texts = list(summed_up(problems))
    lines = [line for text in texts for line in text.split("\n")]
    assert len(texts) <= MAX_KINDS + 1 and max(map(len, lines), default=0) <= MAX_PROBLEM_LENGTH
    more = [int(line.removeprefix("and ").split()[0]) for line in lines if " more " in line and "of this kind" in line]
    rest = [int(text.split()[0]) for text in texts[MAX_KINDS:]]
    shown = len(lines) - len(more) - len(rest)
    assert shown + sum(more) + sum(rest) == len(problems)


def test_what_the_schema_refuses_is_summed_up(tmp_path):
    files = with_variables(200)
    files["modelDescription.xml"] = files["modelDescription.xml"].replace(b"<Real/>", b'<Real wrong="1"/>')
    file = tmp_path / "wrong.fmu"
    file.write_bytes(pack(files))
    (text,) = summed_up(validation_problems(file, read_description(file)))
    assert "wrong" in text and "more of this kind" in text


def test_a_backslash_in_a_path_is_told(tmp_path, quick_pid_file):
    file = shutil.copy(quick_pid_file, tmp_path / "copy.fmu")
    with zipfile.ZipFile(file, "a") as archive:
        member = zipfile.ZipInfo("x")
        member.filename = member.orig_filename = "resources\\x"
        archive.writestr(member, "")
    assert 'The file path "resources\\x" contains a backslash.' in validation._backslashes(file)


@pytest.mark.needs("linux")
def test_a_controller_that_hangs_is_told_once(tmp_path, monkeypatch):
    """The looks behind the one that hangs would hang as well."""
    monkeypatch.setattr("orchestrator.api.checking.CHECK_TIMEOUT", 0.5)
    found = Benchmark("quick").check(Controller(hostile_fmu(tmp_path, Fault("spin", "step", 0.0))))
    *_, hang, rest = found
    assert (hang.subject, hang.severity) == ("timing", "error") and "the limit of processor time" in hang.text
    assert rest.text == "left out after that: repeatability, reset, several instances, termination, cost"
