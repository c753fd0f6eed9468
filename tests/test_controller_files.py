"""Files with connector mappings and parameters: TOML, JSON, lines of names and values, and SSP's SSM and SSV."""

import functools
import re
from dataclasses import replace

import pytest
from fmpy.model_description import BaseUnit, Unit
from support.descriptions import archive, description, variable
from support.refusals import refusal

from orchestrator.fmi import controller_files
from orchestrator.fmi.controller_files import read_mapping

SSM = """<?xml version="1.0" encoding="UTF-8"?>
<ssm:ParameterMapping xmlns:ssm="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"
                      xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon" version="1.0">
  <!-- measurements -->
  <ssm:MappingEntry source="In1" target="q_m[1]"/>
  <ssm:MappingEntry source="In2" target="q_m[2]">{inside}</ssm:MappingEntry>
</ssm:ParameterMapping>
"""
SSV = """<?xml version="1.0" encoding="UTF-8"?>
<ssv:ParameterSet xmlns:ssv="http://ssp-standard.org/SSP{major}/SystemStructureParameterValues" version="{major}.0"
                  name="gains">
  <ssv:Parameters>
    <ssv:Parameter name="K_p[1]"><!-- tuned --><ssv:{real} value="4.5e1"/></ssv:Parameter>
    <ssv:Parameter name="order"><ssv:{integer} value="-3"/></ssv:Parameter>
    {further}
  </ssv:Parameters>
</ssv:ParameterSet>
"""


CONTROLLER = replace(
    archive(),
    description=description(
        [
            variable("K_p[1]", "parameter", "N.m/rad"),
            variable("alpha", "parameter", "deg"),
            variable("n", "parameter"),
            variable("long", "parameter", size=2),
            variable("axis[1]", "parameter"),
            variable("axis[2]", "parameter"),
            variable("odd", "parameter", "furlong"),
            variable("T", "parameter", "degC"),
        ],
        [
            Unit("N.m/rad", BaseUnit(kg=1, m=2, s=-2, rad=-1)),
            Unit("degC", BaseUnit(K=1, offset=273.15)),
            Unit("K", BaseUnit(K=1)),
        ],
    ),
)
read_parameters = functools.partial(controller_files.read_parameters, controller=CONTROLLER)
SUFFIXES = ("toml", "ssm", "ssv", "json", "txt")


@pytest.fixture
def file(tmp_path):
    """Writes a file of a name."""

    def write(name, text):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def refused(read, path):
    """The error's code and value."""
    error = refusal(read, path)
    assert str(path) in error.where and str(path) in str(error) and "\n" not in str(error)
    return error.what, error.value


def test_mappings(file):
    path = file("names.toml", '[map]\n"q_m[1]" = "In1"\n"q_m[2]" = "In2"\nu_m = "Torque"\n')
    assert read_mapping(path) == {"q_m[1]": "In1", "q_m[2]": "In2", "u_m": "Torque"}
    assert read_mapping(file("names.ssm", SSM.format(inside=""))) == {"q_m[1]": "In1", "q_m[2]": "In2"}
    path = file("names.ssm", SSM.format(inside='<ssc:LinearTransformation factor="2"/>'))
    assert refused(read_mapping, path) == ("bad-mapping", "q_m[2]"), "a transformation is not dropped silently"


def ssv(inside, head='xmlns="http://ssp-standard.org/SSP1/SystemStructureParameterValues"', root="ParameterSet"):
    """A parameter set with these parameters."""
    return f"<{root} {head}><Parameters>{inside}</Parameters></{root}>"


def ssm(inside):
    """A mapping with these entries."""
    head = 'xmlns="http://ssp-standard.org/SSP1/SystemStructureParameterMapping"'
    return f"<ParameterMapping {head}>{inside}</ParameterMapping>"


SSV_TWICE = ssv('<Parameter name="K"><Real value="1"/></Parameter><Parameter name="K"><Real value="2"/></Parameter>')
SSM_TWICE = ssm('<MappingEntry source="a" target="q_m"/><MappingEntry source="b" target="q_m"/>')
ONE = '<Parameter name="K"><Real value="1"/></Parameter>'

WRONG_FILES = [
    (read_mapping, "names.toml", '"q_m[1]" = "In1"\n', "bad-mapping"),
    (read_mapping, "names.toml", "[map]\nq_m = 1\n", "bad-mapping"),
    (read_mapping, "names.toml", "[map]\nq_m[1] = In1\n", "bad-file"),
    (read_mapping, "names.toml", b"\xff\xfe", "bad-file"),
    (read_mapping, "names.txt", "q_m=In1", "bad-file"),
    (read_mapping, "names.ssm", "<a><b></a>", "bad-file"),
    (read_mapping, "names.ssm", "", "bad-file"),
    (read_mapping, "names.ssm", "<ParameterSet/>", "bad-mapping"),
    (read_parameters, "gains.toml", "K_p = 45\n", "bad-parameters"),
    (read_parameters, "gains.toml", "[parameters]\nK_p = 2026-11-25\n", "bad-parameters"),
    (read_parameters, "gains.toml", "[parameters]\nK_p = [[1, 2]]\n", "bad-parameters"),
    (read_parameters, "gains.toml", "[parameters.K_p]\naxis1 = 45\n", "bad-parameters"),
    (read_parameters, "gains.toml", "[parameters]\nK_p = []\n", "bad-parameters"),
    (read_parameters, "gains.toml", "[parameters\n", "bad-file"),
    (read_parameters, "gains.json", "{", "bad-file"),
    (read_parameters, "gains.json", b"\xff\xfe", "bad-file"),
    (read_parameters, "gains.json", "[" * 100_000, "bad-file"),
    (read_parameters, "gains.json", '{"n": ' + "9" * 5000 + "}", "bad-file"),
    (read_parameters, "gains.json", "[1]", "bad-parameters"),
    (read_parameters, "gains.json", "{}", "bad-parameters"),
    (read_parameters, "gains.json", '{"n": null}', "bad-parameters"),
    (read_parameters, "gains.json", '{"parameters": {"n": 1}}', "bad-parameters"),
    (read_parameters, "gains.json", '{"n": 1, "n": 2}', "bad-parameters"),
    (read_parameters, "gains.json", '{"K_p": [45, 15], "K_p[1]": 9}', "repeated"),
    (read_parameters, "gains.txt", "n = 1\nn = 2\n", "bad-parameters"),
    (read_parameters, "gains.txt", "n 1\n", "bad-parameters"),
    (read_parameters, "gains.txt", "n =\n", "bad-parameters"),
    (read_parameters, "gains.txt", "# nothing\n", "bad-parameters"),
    (read_parameters, "gains.txt", b"n=\xff", "bad-file"),
    (read_parameters, "gains.ssv", SSV_TWICE, "bad-parameters"),
    (read_mapping, "names.ssm", SSM_TWICE, "bad-mapping"),
    (read_parameters, "gains.toml", "[parameters]\nK_p = [45, 15]\n'K_p[1]' = 9\n", "repeated"),
    (read_parameters, "gains.toml", "[parameter]\nn = 9\n[parameters]\nn = 1\n", "bad-parameters"),
    (read_parameters, "gains.toml", "n = 9\n[parameters]\nn = 1\n", "bad-parameters"),
    (read_parameters, "gains.toml", "[parameters]\nlong = [1]\n", "array-parameter"),
    (read_parameters, "gains.toml", "[parameters]\naxis = [1]\n", "array-parameter"),
    (read_mapping, "names.toml", "[map]\nq_m = 'In'\n[parmeters]\nn = 1\n", "bad-mapping"),
    (read_parameters, "gains.ssv", ssv(ONE, 'xmlns="urn:another"'), "bad-parameters"),
    (read_parameters, "gains.ssv", ssv(ONE, root="SystemStructureDescription"), "bad-parameters"),
    (
        read_parameters,
        "gains.ssv",
        ssv('<Parameter name="K"><Real value="1"/><Real value="2"/></Parameter>'),
        "bad-parameters",
    ),
    (read_parameters, "gains.ssv", ssv(f"<Parameters>{ONE}</Parameters>"), "bad-parameters"),
    (read_parameters, "gains.ssv", ssv(f"{ONE}<Parametre/>"), "bad-file"),
    (read_parameters, "gains.ssv", ssv(ONE.replace('"1"', '"1_0"')), "not-a-number"),
    (read_parameters, "gains.ssv", ssv(ONE.replace('"1"', '"\u0661"')), "not-a-number"),
    (
        read_mapping,
        "names.ssm",
        ssm('<MappingEntry source="a" target="q_m" suppressUnitConversion="true"/>'),
        "bad-mapping",
    ),
    (read_mapping, "names.ssm", ssm('<MappingEntry source="a" target="q_m" factor="2"/>'), "bad-mapping"),
    (read_parameters, "gains.ssv", "no XML", "bad-file"),
    (read_parameters, "gains.ssv", "<ParameterMapping/>", "bad-parameters"),
    *((read, f"absent.{suffix}", None, "no-file") for read in (read_mapping, read_parameters) for suffix in SUFFIXES),
]


@pytest.mark.parametrize(("read", "name", "text", "what"), WRONG_FILES)
def test_wrong_files(read, name, text, what, file, tmp_path):
    path = tmp_path / name if text is None else file(name, text)
    assert refused(read, path)[0] == what


def test_toml_parameters(file):
    path = file("gains.toml", '[parameters]\nK_p = [45, 15.5]\n"T_f" = 0.01\n"K_d[2]" = -1\nn = "3"\non = true\n')
    expected = {"K_p[1]": 45, "K_p[2]": 15.5, "T_f": 0.01, "K_d[2]": -1, "n": "3", "on": True}
    assert read_parameters(path) == expected
    mapped = file("both.toml", f'[map]\nq_m = "In"\n{path.read_text()}')
    assert controller_files.read_mapped_parameters(mapped, CONTROLLER) == expected and read_mapping(mapped) == {
        "q_m": "In"
    }
    assert controller_files.read_mapped_parameters(file("names.toml", '[map]\nq_m = "In"\n'), CONTROLLER) == {}


def test_json_parameters(file):
    path = file("gains.json", '{"K_p": [45, 15.5], "T_f": 1e-2, "n": "3", "on": true}')
    assert read_parameters(path) == {"K_p[1]": 45, "K_p[2]": 15.5, "T_f": 0.01, "n": "3", "on": True}


@pytest.mark.parametrize("ending", controller_files.LINES)
def test_parameters_in_lines(file, ending):
    path = file(f"gains{ending}", "\ufeff# gains of the loop\r\nK_p[1]=45\r\n\n// beside\nT_f = 1e-2\nfile = a=b\n")
    assert read_parameters(path) == {"K_p[1]": "45", "T_f": "1e-2", "file": "a=b"}


@pytest.mark.parametrize(("major", "real", "integer"), [(1, "Real", "Integer"), (2, "Float64", "Int32")])
def test_ssv_parameters(file, major, real, integer):
    path = file("gains.ssv", SSV.format(major=major, real=real, integer=integer, further=""))
    assert read_parameters(path) == {"K_p[1]": 45.0, "order": "-3"}
    further = '<ssv:Parameter name="on"><ssv:Boolean value="true"/></ssv:Parameter>'
    further += '<ssv:Parameter name="file"><ssv:String value="x"/></ssv:Parameter>'
    further += '<ssv:Parameter name="mode"><ssv:Enumeration value="Manual"/></ssv:Parameter>'
    path = file("more.ssv", SSV.format(major=major, real=real, integer=integer, further=further))
    assert read_parameters(path).items() >= {"on": "true", "file": "x", "mode": "Manual"}.items()


@pytest.mark.parametrize(
    ("further", "complaint"),
    [
        ('<ssv:Parameter name="on"><ssv:Distribution value="1"/></ssv:Parameter>', ("bad-parameters", "on")),
        ('<ssv:Parameter name="none"/>', ("bad-parameters", "none")),
        ('<ssv:Parameter name="K"><ssv:Real value="much"/></ssv:Parameter>', ("not-a-number", "much")),
        ('<ssv:Parameter name="K"><ssv:Real/></ssv:Parameter>', ("bad-parameters", "K")),
    ],
)
def test_nothing_in_an_ssv_is_dropped_silently(file, further, complaint):
    path = file("gains.ssv", SSV.format(major=1, real="Real", integer="Integer", further=further))
    assert refused(read_parameters, path) == complaint


UNITS = """<ssv:Units xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssc:Unit name="mN.m/rad"><ssc:BaseUnit kg="1" m="2" s="-2" rad="-1" factor="0.001"/></ssc:Unit>
  <ssc:Unit name="rev"/>
</ssv:Units>
"""


def with_unit(name, unit, value="45000"):
    """An SSV file that gives one more parameter in a unit."""
    parameter = f'<ssv:Parameter name="{name}"><ssv:Real value="{value}" unit="{unit}"/></ssv:Parameter>'
    text = SSV.format(major=1, real="Real", integer="Integer", further="")
    text = re.sub(rf'<ssv:Parameter name="{re.escape(name)}".*?</ssv:Parameter>', "", text, flags=re.DOTALL)
    return text.replace("</ssv:Parameters>", f"{parameter}</ssv:Parameters>").replace(
        "</ssv:Parameters>", f"</ssv:Parameters>{UNITS}"
    )


@pytest.mark.parametrize(
    ("name", "unit", "value"),
    [
        ("K_p[1]", "mN.m/rad", 45.0),
        ("K_p[1]", "N.m/rad", 45e3),
        ("K_p[1]", "N.m", 45e3),
        ("alpha", "rad", 45e3 * 57.29577951308232),
        ("odd", "furlong", 45e3),
        ("T", "degC", 45e3),
    ],
)
def test_units_in_an_ssv_are_converted_to_the_controllers(file, name, unit, value):
    assert read_parameters(file("gains.ssv", with_unit(name, unit)))[name] == pytest.approx(value, rel=1e-14)


@pytest.mark.parametrize(
    ("name", "unit", "what"),
    [
        ("K_p[1]", "s", "wrong-unit"),
        ("K_p[1]", "rev", "unknown-unit"),
        ("n", "s", "unknown-unit"),
        ("T", "K", "wrong-unit"),
    ],
)
def test_units_in_an_ssv_that_do_not_fit_are_refused(file, name, unit, what):
    assert refused(read_parameters, file("gains.ssv", with_unit(name, unit))) == (what, unit)
    assert refusal(read_parameters, file("gains.ssv", with_unit("K_q[1]", unit))).what == "no-parameter"


@pytest.mark.parametrize(
    ("definition", "what"),
    [
        ('<ssc:Unit name="rad"><ssc:BaseUnit rad="1" factor="2"/></ssc:Unit>', "bad-unit"),
        ('<ssc:Unit name="half"><ssc:BaseUnit rad="0.5"/></ssc:Unit>', "bad-unit"),
        ('<ssc:Unit name="mN.m/rad"/>', "bad-unit"),
    ],
)
def test_units_that_an_ssv_defines_against_their_names_are_refused(file, definition, what):
    unit = re.search('name="(.*?)"', definition)[1]
    text = with_unit("alpha", unit).replace("</ssv:Units>", f"{definition}</ssv:Units>")
    assert refused(read_parameters, file("gains.ssv", text)) == (what, unit)


def test_what_another_tool_has_noted_in_a_parameter_set_is_no_parameter(file):
    noted = f'<Annotations><Annotation><x:y xmlns:x="urn:x">{ONE.replace("K", "n")}</x:y></Annotation></Annotations>'
    text = ssv(ONE).replace("<Parameters>", f"{noted}<Parameters>")
    assert read_parameters(file("gains.ssv", text)) == {"K": 1.0}


def test_entities_are_not_expanded(file, tmp_path):
    secret = file("secret.txt", "45")
    document = f'<!DOCTYPE a [<!ENTITY s SYSTEM "{secret.as_uri()}">]>'
    path = file("names.ssm", document + ssm('<MappingEntry target="q_m">&s;</MappingEntry>'))
    assert "45" not in str(read_mapping(path))
