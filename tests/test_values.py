"""Values of parameters, and of inputs that nothing drives: of every type, however given, up to the calls of FMI."""

import json
import re
from dataclasses import replace
from fractions import Fraction

import pytest
from exporters.description_edits import edited
from hypothesis import given
from hypothesis import strategies as st
from support.command_lines import call
from support.descriptions import archive, description, usual, variable
from support.python_controllers import python_controller
from support.refusals import refusal

import build_fmus
from controller_fmu.export import python_fmu
from controller_fmu.export.archive import pack, unpack
from orchestrator import Benchmark, Controller, Evaluation
from orchestrator.codec import from_json, to_json
from orchestrator.documents.commands import simulate_command
from orchestrator.documents.head import ControllerRecord
from orchestrator.documents.wording import remarks
from orchestrator.fmi.archive import open_archive
from orchestrator.fmi.controller_files import read_parameters
from orchestrator.fmi.lookup import canonical_values, find_values, typed
from orchestrator.fmi.slaves import load
from orchestrator.fmi.variables import INTEGERS, Variable, variables
from orchestrator.loop.setup import Setup, controller_binding, held_inputs
from orchestrator.text import spelled

WHAT = "The controller x.fmu"


def of_type(kind, **others):
    return Variable("v", 0, kind, 1, "parameter", "fixed", None, (), **others)


MODE = of_type("Enumeration", items=((1, "Off"), (2, "Manual"), (5, "Automatic")))


@pytest.mark.parametrize(
    ("one", "given", "value"),
    [
        (of_type("Real"), 3, 3.0),
        (of_type("Real"), "4.5e1", 45.0),
        (of_type("Int8"), "-128", -128),
        (of_type("UInt64"), str(2**64 - 1), 2**64 - 1),
        (of_type("Integer"), 2.0, 2),
        (MODE, "Manual", 2),
        (MODE, "5", 5),
        (MODE, 1, 1),
        (of_type("Boolean"), "True", True),
        (of_type("Boolean"), 0, False),
        (of_type("String"), " a,b=c ", " a,b=c "),
        (of_type("Binary"), "0A ff", "0aff"),
    ],
)
def test_a_value_gets_the_type_of_its_variable(one, given, value):
    found = typed(one, given, WHAT)
    assert found == value and type(found) is type(value)


@pytest.mark.parametrize(
    ("one", "given", "what", "words"),
    [
        (of_type("Real"), True, "not-a-number", "True"),
        (of_type("Real"), "much", "not-a-number", "'much'"),
        (of_type("Real"), "nan", "not-finite", "finite"),
        (of_type("Float32"), 1e39, "not-finite", "Float32"),
        (of_type("Int8"), 128, "bad-value", "from -128 to 127"),
        (of_type("UInt16"), -1, "bad-value", "from 0 to 65535"),
        (of_type("Integer"), 2.5, "bad-value", "whole"),
        (of_type("Integer"), True, "bad-value", "whole"),
        (MODE, "manual", "bad-value", "Nearest: Manual"),
        (MODE, 3, "bad-value", "no item 3"),
        (of_type("Boolean"), "yes", "bad-value", "neither true nor false"),
        (of_type("Boolean"), 2, "bad-value", "neither true nor false"),
        (of_type("String"), 3, "bad-value", "not a text"),
        (of_type("String"), "a\0b", "bad-value", "ends before"),
        (of_type("Binary"), "0", "bad-value", "hexadecimal"),
    ],
)
def test_a_value_that_a_variable_does_not_take_is_refused_in_a_sentence(one, given, what, words):
    error = refusal(typed, one, given, WHAT)
    assert error.what == what and words in str(error) and "\n" not in str(error)
    assert "Manual" in error.nearest if given == "manual" else True


WHOLE = [of_type(kind) for kind in INTEGERS if kind != "Enumeration"]


@given(st.data())
def test_what_is_recorded_gives_the_same_value_again_whatever_way_it_takes(data):
    """A recorded value, through JSON or a command line, is itself again: nothing is told apart twice, or not at all."""
    one = data.draw(st.sampled_from([*WHOLE, MODE, *map(of_type, ("Real", "Boolean", "String", "Binary"))]))
    low, high = INTEGERS.get(one.type, (0, 0))
    value = {
        "Real": lambda: data.draw(st.floats(allow_nan=False, allow_infinity=False)),
        "Boolean": lambda: data.draw(st.booleans()),
        "String": lambda: data.draw(st.text(st.characters(codec="utf-8", exclude_characters="\0"))),
        "Binary": lambda: data.draw(st.binary()).hex(),
        "Enumeration": lambda: data.draw(st.sampled_from((1, 2, 5))),
    }.get(one.type, lambda: data.draw(st.integers(low, high)))()
    for again in (value, spelled(value), from_json(to_json({"v": value}), dict[str, bool | int | float | str])["v"]):
        found = typed(one, again, WHAT)
        assert found == value and type(found) is type(value)


SHOWN = usual(
    variable("enable", kind="Boolean", start="false"),
    variable("gain", kind="Int32", size=3, start="1 2 3"),
    variable("name", "parameter", kind="String", start="a b"),
    variable("rest", "input", "rad"),
)


def test_inputs_that_nothing_drives_are_known_with_the_values_they_keep():
    shown = replace(archive(), description=SHOWN)
    setup = Setup({"gain[2]": 7, "rest": 0.5})
    held = held_inputs(shown, setup, controller_binding(shown, setup))
    assert held == {"enable": False, "gain[1]": 1, "gain[2]": 7, "gain[3]": 3, "rest": 0.5}
    assert variables(SHOWN)["name"].start == ("a b",)
    found = find_values(SHOWN, {"gain[2]": "7", "enable": "true", "name": "x"}, WHAT)
    assert {one.name: values for one, values in found.items()} == {"gain": [1, 7, 3], "enable": [True], "name": ["x"]}
    limited = description([variable("K", "parameter", start="1", min="0", max="2")])
    error = refusal(find_values, limited, {"K": 2.5}, WHAT)
    assert error.what == "bad-value" and "from 0 to 2" in str(error)
    assert refusal(controller_binding, shown, Setup({"q_m[1]": 1.0})).what == "connector-parameter"


def test_the_form_that_is_recorded_does_not_depend_on_how_a_value_was_given():
    shown = description([variable("K", "parameter"), variable("on", kind="Boolean")])
    forms = [canonical_values(shown, {"K": k, "on": on}, WHAT) for k, on in ((45, 1), ("45", "true"), (45.0, True))]
    assert all(to_json(form) == '{\n "K": 45.0,\n "on": true\n}' for form in forms)


KINDS = {
    1: ("Boolean", "Integer", "String"),
    2: ("Boolean", "Integer", "String"),
    3: ("Boolean", "String", "Binary", *(f"{sign}Int{bits}" for bits in (8, 16, 32, 64) for sign in ("", "U"))),
}
WEIGHTS = {"Boolean": 1.0, "String": 1e4, "Binary": 1e4}
"""What a unit of each type adds to K_p[1], 10 for an integer; of a text its first byte counts."""


def adding(kind, version):
    """A setter in C that adds what it is given to K_p[1], the model's sixth variable."""
    element = "(unsigned char)value[i][0]" if kind in ("String", "Binary") else "(double)value[i]"
    body = f"for (size_t i = 0; i < n; i++) SELF->memory->model[6] += {WEIGHTS.get(kind, 10.0)} * {element}; (void)vr;"
    if version == 3:
        sizes = "const size_t sizes[], " if kind == "Binary" else ""
        arguments = f"{sizes}const fmi3{kind} value[], size_t n_values"
        own = f"VARIABLES(fmi3Set{kind}, {arguments}) {{ (void)n_values; {'(void)sizes;' if sizes else ''} {body}"
        return f"{own} return fmi3OK; }}\n"
    name = "fmi" if version == 1 else "fmi2"
    return f"VARIABLES({name}Set{kind}, const fmi{version}{kind}) {{ {body} return fmi{version}OK; }}\n"


def with_all_types(version, folder):
    """The PID, with an input and a parameter of each type of FMI ``version`` beside it."""
    sources = build_fmus.HERE / "controller_fmu" / "pid_c"
    built = folder / f"Pid{version}.fmu"
    build_fmus.c_fmu(
        sorted(sources.glob("*.[ch]")), sources / "modelDescription.xml", built, build_fmus.Dialect(version)
    )
    contents = {name: data for name, data in unpack(built).items() if not name.startswith("binaries/")}
    glue = next(name for name in contents if name.endswith(f"fmi{version}.c"))
    text = contents[glue].decode()
    for kind in KINDS[version]:
        if version == 3:
            getter = f"NO_VARIABLES(fmi3Get{kind}, TO_READ, fmi3{kind} values[], size_t n_values)\n"
            pattern = (
                rf"^NO_VARIABLES_OF_TYPE\({kind}\)$" if kind != "Binary" else r"^NO_VARIABLES\(fmi3SetBinary,[^)]*\)$"
            )
            text, count = re.subn(pattern, (getter if kind != "Binary" else "") + adding(kind, 3), text, flags=re.M)
        else:
            name = "fmi" if version == 1 else "fmi2"
            text, count = re.subn(rf"^NO_VARIABLES\({name}Set{kind},[^)]*\)$", adding(kind, version), text, flags=re.M)
        assert count == 1, kind
    built.write_bytes(pack({**contents, glue: text.encode()}))

    def declare(root):
        listed = root.find("ModelVariables")
        for number, kind in enumerate(KINDS[version], start=100):
            for causality, reference in (("input", number), ("parameter", number + 100)):
                head = {"name": f"{causality}_{kind}", "valueReference": str(reference), "causality": causality}
                variability = "discrete" if causality == "input" else "tunable"
                if version == 1:
                    variability = "discrete" if causality == "input" else "parameter"
                    head["causality"] = "input" if causality == "input" else "internal"
                head["variability"] = variability
                start = {"Boolean": "false", "String": "", "Binary": ""}.get(kind, "0")
                if version == 3:
                    own = listed.makeelement(kind, head)
                    if kind in ("String", "Binary"):
                        own.append(own.makeelement("Start", {"value": start}))
                    else:
                        own.set("start", start)
                else:
                    own = listed.makeelement("ScalarVariable", head)
                    own.append(own.makeelement(kind, {"start": start}))
                listed.append(own)

    return edited(built, folder / f"Types{version}.fmu", declare)


@pytest.mark.needs("compiler")
@pytest.mark.parametrize("version", KINDS)
def test_an_fmu_is_given_values_of_every_type(version, tmp_path):
    """What the setters in C were given is what the user gave: it is read back from K_p[1], to which they add it."""
    opened = open_archive(with_all_types(version, tmp_path))
    given = {"Boolean": "true", "String": "C", "Binary": "2a"}
    wanted, total = {}, 45.0
    for kind in KINDS[version]:
        for number, causality in enumerate(("input", "parameter"), start=2):
            value = given.get(kind, str(number))
            wanted[f"{causality}_{kind}"] = value
            total += {"Boolean": 1.0, "String": 1e4 * ord("C"), "Binary": 1e4 * 0x2A}.get(kind, 10.0 * number)
    values = find_values(opened.description, wanted, WHAT)
    assert len(values) == 2 * len(KINDS[version])
    slave = load(opened)
    gain = variables(opened.description)["K_p[1]"]
    with slave.instantiated(1.0):
        assert slave.get([gain]) == [45.0]
        slave.initialize(
            {one: value for one, value in values.items() if one.causality == "parameter"},
            {one: value for one, value in values.items() if one.causality == "input"},
        )
        assert slave.get([gain]) == [total]


BEGIN = (
    "self.gains = {'enable': False, 'mode': 1, 'label': ''}; "
    "[self.register_variable(kind(name, "
    "causality=Fmi2Causality.input if name == 'enable' else Fmi2Causality.parameter, "
    "variability=Fmi2Variability.discrete if name == 'enable' else Fmi2Variability.tunable, "
    "getter=(lambda name=name: self.gains[name]), "
    "setter=(lambda value, name=name: self.gains.__setitem__(name, value)))) "
    "for kind, name in ((Boolean, 'enable'), (Integer, 'mode'), (String, 'label'))]"
)
LAW = (
    "g = self.gains; self.own['K'] = 45.0 * g['mode'] if g['enable'] and g['label'] == 'go' else 0.0; "
    "self.law(); return True"
)


@pytest.fixture(scope="module")
def switched(tmp_path_factory):
    """A controller that does nothing unless enable is true and label is "go"; mode multiplies its gain."""
    folder = tmp_path_factory.mktemp("switched")
    script = "from pythonfmu import Boolean, Integer, String"
    file = python_controller(folder, "Switched", 45.0, imports=script, step_body=LAW)
    # The variables are registered also while it is built, so that they are in the description.
    source = next((folder / "sources" / "Switched").glob("*.py"))
    text = source.read_text().replace(
        "        if self.instance_name", f"        {BEGIN}\n        if self.instance_name"
    )
    source.write_text(text)
    return python_fmu(source, [], source.stem, file)


def test_a_controller_that_must_be_enabled_is_named_and_enabled(switched, tmp_path):
    bench = Benchmark("quick")
    frozen = bench.check(Controller(switched))
    (finding,) = (one for one in frozen if one.subject == "inputs")
    assert finding.severity.value == "warning" and "enable = false" in finding.text
    assert (finding.what, finding.value) == ("undriven-switch", "enable")
    assert any("mode [Integer] = 1" in one.text for one in frozen if one.subject == "can be set")
    used = {"enable": True, "mode": 1, "label": "go"}
    findings = bench.check(Controller(switched, parameters=used))
    assert not [one for one in findings if one.severity.value in ("warning", "error")], list(findings)
    (tmp_path / "use.toml").write_text('[map]\n[parameters]\nenable = true\nlabel = "go"\nmode = 1\n')
    (tmp_path / "use.ssv").write_text(
        '<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP1/SystemStructureParameterValues">'
        '<ssv:Parameters><ssv:Parameter name="enable"><ssv:Boolean value="true"/></ssv:Parameter>'
        '<ssv:Parameter name="label"><ssv:String value="go"/></ssv:Parameter>'
        '<ssv:Parameter name="mode"><ssv:Integer value="1"/></ssv:Parameter></ssv:Parameters></ssv:ParameterSet>'
    )
    ways = [
        Controller(switched, used),
        Controller(switched, {"enable": "true", "mode": "1", "label": "go"}),
        Controller(switched, tmp_path / "use.toml"),
        Controller(switched, mapping=tmp_path / "use.toml"),
        Controller(switched, tmp_path / "use.ssv"),
    ]
    assert {to_json(dict(sorted(way.setup.parameters.items()))) for way in ways} == {
        to_json(dict(sorted(used.items())))
    }
    assert read_parameters(tmp_path / "use.ssv", ways[0].archive)["enable"] == "true"
    case = Benchmark("quick").cases[0]
    quiet = {name: bench.simulate(Controller(switched, values), case) for name, values in (("on", used), ("off", {}))}
    assert abs(quiet["on"].torque - quiet["off"].torque).max() > 1e-3


def test_results_record_values_with_their_types_and_what_nothing_drives(switched, tmp_path):
    bench, used = Benchmark("quick"), {"enable": True, "label": "go", "mode": 1}
    case = bench.cases[0].id
    on = bench.evaluate(Controller(switched, used), only=case, recordings=False)
    off = bench.evaluate(Controller(switched, {"label": "go", "mode": 1.0}), only=case, recordings=False)
    on.save(tmp_path / "on")
    written = json.loads((tmp_path / "on" / "results.json").read_text())["head"]["controller"]
    assert written["parameters"] == used and written["held"] == {"enable": True}
    assert Evaluation.load(tmp_path / "on").results.controller == on.results.controller
    assert off.results.controller.held == {"enable": False} and type(off.results.controller.parameters["mode"]) is int
    assert any("input enable" in remark for remark in remarks(off.results))
    assert not any("input enable" in remark for remark in remarks(on.results))
    assert "--set enable=true --set label=go --set mode=1" in simulate_command(on.results.head, case)
    assert call("check", switched, "--set", "enable=maybe", folder=tmp_path).code == 2


def test_results_of_an_earlier_version_are_read():
    old = {
        "file": "x.fmu",
        "sha256": "",
        "fmi_version": "2.0",
        "generation_tool": None,
        "parameters": {"K_p[1]": 45.0},
        "path": "x.fmu",
        "mapping": {},
        "connectors": {"q_a_ref": None},
    }
    record = from_json(json.dumps(old), ControllerRecord)
    assert record.held == {} and type(record.parameters["K_p[1]"]) is float
    assert Fraction(record.parameters["K_p[1]"]) == 45
