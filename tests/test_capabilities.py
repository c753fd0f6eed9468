"""The table of capabilities: it has all that the standards' schemas have, and what it refuses is refused by name."""

import ctypes
import subprocess
from dataclasses import replace
from pathlib import Path

import fmpy
import pytest
from exporters.description_edits import edited
from lxml import etree
from support.command_lines import call
from support.descriptions import T_S, archive, pair, usual
from support.python_controllers import python_controller
from support.refusals import refusal

import build_fmus
from benchmarks import capability_page
from orchestrator.fmi.archive import open_archive
from orchestrator.fmi.connectors import bind_controller
from orchestrator.fmi.description import CAPABILITIES, FLAGS, VARIABLES, declared, refuse_unsupported
from orchestrator.fmi.slaves.base import refusal as load_refusal
from orchestrator.loop.sampling import controller_sample_time

SCHEMAS = Path(fmpy.__file__).parent / "schema"
XS = "{http://www.w3.org/2001/XMLSchema}"
TYPES = {
    "1": ("fmi1/fmiImplementation.xsd", "//*[@name='fmiCoSimulationCapabilities']"),
    "2": ("fmi2/fmi2ModelDescription.xsd", "//*[@name='ModelExchange' or @name='CoSimulation']/*"),
    "3": (
        "fmi3/fmi3InterfaceType.xsd",
        "//*[@name='fmi3InterfaceType' or @name='fmi3ModelExchange' or @name='fmi3CoSimulation']",
    ),
}
"""By major version of FMI: the schema with the flags, and the definitions there that have them."""

VARIABLE_TYPES = {
    "1": ("fmi1/fmiScalarVariable.xsd", ".//{*}choice/{*}element"),
    "2": ("fmi2/fmi2ScalarVariable.xsd", ".//{*}choice/{*}element"),
    "3": ("fmi3/fmi3Variable.xsd", ".//{*}group/{*}choice/{*}element"),
}


def flags(version):
    """The names of the flags in a schema: attributes of the definitions themselves, not of elements within."""
    file, definitions = TYPES[version]
    root = etree.parse(str(SCHEMAS / file))
    found = set()
    for definition in root.xpath(definitions):
        paths = (f"{XS}attribute", f"{XS}complexContent/{XS}extension/{XS}attribute")
        found |= {attribute.get("name") for path in paths for attribute in definition.iterfind(path)}
    return found


@pytest.mark.parametrize("version", TYPES)
def test_the_table_has_each_flag_of_the_schemas_once(version):
    listed = [row.name for row in FLAGS if version in row.versions]
    assert sorted(listed) == sorted(flags(version) | {"modelIdentifier"})


@pytest.mark.parametrize("version", VARIABLE_TYPES)
def test_the_table_has_each_type_of_variable(version):
    file, path = VARIABLE_TYPES[version]
    types = {element.get("name") for element in etree.parse(str(SCHEMAS / file)).getroot().iterfind(path)}
    listed = {row.name for row in VARIABLES if version in row.versions and row.name[0].isupper()}
    assert types - {None} == listed and len(types) >= 5


ASKING = {
    ("ModelExchange", "1"): ("1.0", ""),
    ("manualStart", "1"): (
        "1.0",
        '<Implementation><CoSimulation_Tool><Model manualStart="1"/></CoSimulation_Tool></Implementation>',
    ),
    ("ScheduledExecution", "3"): ("3.0", '<ScheduledExecution modelIdentifier="X"/>'),
    ("Clock", "3"): ("3.0", '<CoSimulation/><ModelVariables><Clock name="tick" causality="input"/></ModelVariables>'),
    ("clocks", "3"): ("3.0", '<CoSimulation/><ModelVariables><Float64 name="u" clocks="7"/></ModelVariables>'),
}
"""Of each row that is refused, the smallest description that asks for it."""


def test_each_row_that_is_refused_refuses_and_has_an_example():
    assert {(row.name, row.versions) for row in CAPABILITIES if row.standing == "refused"} == set(ASKING)
    for (name, _), (version, inside) in ASKING.items():
        root = etree.fromstring(f'<fmiModelDescription fmiVersion="{version}">{inside}</fmiModelDescription>')
        error = refusal(refuse_unsupported, root, "x.fmu")
        assert (error.what, error.value) == ("unsupported-fmi", name) and "\n" not in str(error)
    assert all((row.standing == "refused") == bool(row.refused) for row in CAPABILITIES)


def test_the_flags_of_the_kind_that_is_used_are_listed():
    inside = '<CoSimulation hasEventMode="true" canGetAndSetFMUState="0" fixedInternalStepSize="1e-3" x="true"/>'
    root = etree.fromstring(f'<fmiModelDescription fmiVersion="3.0"><ModelExchange/>{inside}</fmiModelDescription>')
    assert [(row.name, value) for row, value in declared(root)] == [
        ("hasEventMode", "true"),
        ("fixedInternalStepSize", "1e-3"),
    ]


@pytest.mark.needs("compiler")
def test_an_fmu_with_an_input_clock_is_refused_by_name(tmp_path):
    """It was evaluated as a controller that never computes, with exit code 0."""
    sources = build_fmus.HERE / "controller_fmu" / "pid_c"
    file = tmp_path / "Pid.fmu"
    build_fmus.c_fmu(sorted(sources.glob("*.[ch]")), sources / "modelDescription.xml", file, build_fmus.Dialect(3))

    def clocked(root):
        listed = root.find("ModelVariables")
        clock = {"name": "sample", "valueReference": "900", "causality": "input", "intervalVariability": "triggered"}
        listed.append(listed.makeelement("Clock", clock))

    clocked_file = edited(file, tmp_path / "Clocked.fmu", clocked)
    error = refusal(open_archive, clocked_file)
    assert error.value == "Clock" and "the clock sample" in str(error)
    for command in ("check", "evaluate"):
        finished = call(command, clocked_file, folder=tmp_path)
        assert finished.code == 2 and "the clock sample" in " ".join((finished.out + finished.err).split())


def test_a_step_that_the_internal_step_does_not_divide_is_refused():
    assert controller_sample_time(archive(fixed="0.00005"), T_S, T_S).value == T_S
    error = refusal(controller_sample_time, archive(fixed="0.0005"), T_S, T_S)
    assert (error.what, error.value) == ("fixed-step", "0.0005")


def test_the_page_is_made_from_the_table():
    text = capability_page.PAGE.read_text(encoding="utf-8")
    assert capability_page.page(text) == text


@pytest.mark.parametrize("spelling", ["q_m[{},1]", "q_m[{}, 1]", "q_m[{}][1]", "q_m({},1)", "Loop.q_m[{},1]"])
def test_the_elements_of_a_matrix_of_one_column_are_recognized(spelling):
    shown = usual(*pair([spelling.format(1), spelling.format(2)]), without="q_m")
    bound = bind_controller(shown, "The controller x.fmu")["q_m"]
    assert [variable.name for variable in bound.variables] == [spelling.format(1), spelling.format(2)]
    other = usual(*pair([spelling.format(1).replace("1]", "2]").replace("1)", "2)"), "q_m_2"]), without="q_m")
    assert refusal(bind_controller, other, "The controller x.fmu").what.startswith("connector")


def test_a_step_of_2_ms_has_a_remedy(tmp_path):
    file = python_controller(tmp_path, "Slow", 1.0, 2e-3)
    finished = call("check", file, folder=tmp_path)
    assert "--sample-time 0.00025" in " ".join(finished.out.split())


@pytest.mark.needs("compiler")
def test_a_library_beside_the_binary_that_is_not_found_has_a_remedy(tmp_path):
    beside, main = tmp_path / "beside.c", tmp_path / "main.c"
    beside.write_text("int beside(void) { return 1; }")
    main.write_text("int beside(void); int main_(void) { return beside(); }")
    compiler, folder = build_fmus.find_compiler(), tmp_path / "binaries" / "linux64"
    folder.mkdir(parents=True)
    for words in ([beside, "-o", folder / "libbeside.so"], [main, "-o", folder / "x.so", f"-L{folder}", "-lbeside"]):
        subprocess.run([*compiler, "-shared", "-fPIC", *map(str, words)], check=True)
    with pytest.raises(OSError) as loaded:
        ctypes.CDLL(str(folder / "x.so"))
    error = load_refusal(replace(archive(), folder=tmp_path), loaded.value)
    assert "libbeside.so" in str(error) and "$ORIGIN" in str(error) and "binaries/linux64" in str(error)
