"""Files with connector mappings and parameters: TOML, and SSP's SSM and SSV."""

from __future__ import annotations

import functools
from dataclasses import replace

import pytest
from descriptions import archive, description, variable
from fmpy.model_description import BaseUnit, Unit

from orchestrator import settings
from orchestrator.errors import InputError
from orchestrator.settings import read_mapping

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
read_parameters = functools.partial(settings.read_parameters, controller=CONTROLLER)


@pytest.fixture
def file(tmp_path):
    """Writes a file of a name."""

    def write(name, text):
        path = tmp_path / name
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


def told(read, path):
    with pytest.raises(InputError) as caught:
        read(path)
    message = str(caught.value)
    assert str(path) in message and "\n" not in message
    return message


# ---- Mappings ----


def test_toml_mapping(file):
    path = file("names.toml", '[map]\n"q_m[1]" = "In1"\n"q_m[2]" = "In2"\nu_m = "Torque"\n')
    assert read_mapping(path) == {"q_m[1]": "In1", "q_m[2]": "In2", "u_m": "Torque"}


def test_ssm_mapping(file):
    assert read_mapping(file("names.ssm", SSM.format(inside=""))) == {"q_m[1]": "In1", "q_m[2]": "In2"}


def test_ssm_transformation_is_not_dropped_silently(file):
    path = file("names.ssm", SSM.format(inside='<ssc:LinearTransformation factor="2"/>'))
    assert "the mapping of q_m[2] has a LinearTransformation, which is not understood" in told(read_mapping, path)


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("names.toml", '"q_m[1]" = "In1"\n', "has no table [map]"),
        ("names.toml", "[map]\nq_m = 1\n", "has no table [map] of lines like"),
        ("names.toml", "[map]\nq_m[1] = In1\n", "is no TOML file"),
        ("names.toml", b"\xff\xfe", "is no TOML file"),
        ("names.toml", "", "has no table [map]"),
        ("names.txt", "q_m=In1", "is no TOML file"),
        ("names.ssm", "<a><b></a>", "is no well-formed XML file"),
        ("names.ssm", "", "is no well-formed XML file"),
        ("names.ssm", "<ParameterSet/>", "has no MappingEntry"),
    ],
)
def test_wrong_mapping_files(file, name, text, complaint):
    assert complaint in told(read_mapping, file(name, text))


# ---- Parameters ----


def test_toml_parameters(file):
    path = file("gains.toml", '[parameters]\nK_p = [45, 15.5]\n"T_f" = 0.01\n"K_d[2]" = -1\nn = "3"\n')
    assert read_parameters(path) == {"K_p[1]": 45.0, "K_p[2]": 15.5, "T_f": 0.01, "K_d[2]": -1.0, "n": 3.0}


@pytest.mark.parametrize(("major", "real", "integer"), [(1, "Real", "Integer"), (2, "Float64", "Int32")])
def test_ssv_parameters(file, major, real, integer):
    path = file("gains.ssv", SSV.format(major=major, real=real, integer=integer, further=""))
    assert read_parameters(path) == {"K_p[1]": 45.0, "order": -3.0}


@pytest.mark.parametrize(
    ("further", "complaint"),
    [
        ('<ssv:Parameter name="on"><ssv:Boolean value="true"/></ssv:Parameter>', "parameter on has no value of type"),
        ('<ssv:Parameter name="file"><ssv:String value="x"/></ssv:Parameter>', "parameter file has no value of type"),
        ('<ssv:Parameter name="none"/>', "parameter none has no value of type"),
        ('<ssv:Parameter name="K"><ssv:Real value="much"/></ssv:Parameter>', "value of K, 'much', is no number"),
        ('<ssv:Parameter name="K"><ssv:Real/></ssv:Parameter>', "value of K, None, is no number"),
    ],
)
def test_nothing_in_an_ssv_is_dropped_silently(file, further, complaint):
    path = file("gains.ssv", SSV.format(major=1, real="Real", integer="Integer", further=further))
    assert complaint in told(read_parameters, path)


UNITS = """<ssv:Units xmlns:ssc="http://ssp-standard.org/SSP1/SystemStructureCommon">
  <ssc:Unit name="mN.m/rad"><ssc:BaseUnit kg="1" m="2" s="-2" rad="-1" factor="0.001"/></ssc:Unit>
  <ssc:Unit name="rev"/>
</ssv:Units>
"""


def with_unit(name, unit, value="45000"):
    """An SSV file that gives one more parameter in a unit."""
    parameter = f'<ssv:Parameter name="{name}"><ssv:Real value="{value}" unit="{unit}"/></ssv:Parameter>'
    text = SSV.format(major=1, real="Real", integer="Integer", further=parameter)
    return text.replace("</ssv:Parameters>", f"</ssv:Parameters>{UNITS}")


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
    ("name", "unit", "complaint"),
    [
        ("K_p[1]", "s", "the parameter K_p[1] is given in 's', which is no N.m/rad. Give it in N.m/rad"),
        ("K_p[1]", "rev", "'rev', which cannot be compared to the FMU's unit for it, N.m/rad"),
        ("n", "s", "cannot be compared to the FMU's unit for it, none"),
        ("T", "K", "is given in 'K', which is no degC"),
    ],
)
def test_units_in_an_ssv_that_do_not_fit_are_refused(file, name, unit, complaint):
    assert complaint in told(read_parameters, file("gains.ssv", with_unit(name, unit)))


def test_an_unknown_parameter_with_a_unit_is_answered_with_the_nearest(file):
    with pytest.raises(InputError, match=r"x\.fmu has no parameter K_q\[1\]\. Nearest: K_p\[1\]"):
        read_parameters(file("gains.ssv", with_unit("K_q[1]", "s")))


@pytest.mark.parametrize(
    ("name", "text", "complaint"),
    [
        ("gains.toml", "K_p = 45\n", "has no table [parameters]"),
        ("gains.toml", "[parameters]\nK_p = true\n", "value of K_p, True, is no number"),
        ("gains.toml", "[parameters]\nK_p = 'much'\n", "value of K_p, 'much', is no number"),
        ("gains.toml", "[parameters]\nK_p = [[1, 2]]\n", "value of K_p, [1, 2], is no number"),
        ("gains.toml", "[parameters.K_p]\naxis1 = 45\n", "is no number"),
        ("gains.toml", "[parameters\n", "is no TOML file"),
        ("gains.ssv", "no XML", "is no well-formed XML file"),
        ("gains.ssv", "<ParameterMapping/>", "has no Parameter"),
    ],
)
def test_wrong_parameter_files(file, name, text, complaint):
    assert complaint in told(read_parameters, file(name, text))


# ---- Files as such ----


@pytest.mark.parametrize("read", [read_mapping, read_parameters])
@pytest.mark.parametrize("suffix", ["toml", "ssm", "ssv"])
def test_a_missing_file_is_told(read, suffix, tmp_path):
    assert "cannot be read" in told(read, tmp_path / f"absent.{suffix}")


def test_entities_are_not_expanded(file, tmp_path):
    secret = file("secret.txt", "45")
    document = f'<!DOCTYPE a [<!ENTITY s SYSTEM "{secret.as_uri()}">]>'
    path = file("names.ssm", f'{document}<a><MappingEntry target="q_m">&s;</MappingEntry></a>')
    assert "45" not in str(read_mapping(path))
