"""Units at a connection: by base units where they are defined, by name where they are known, never silently."""

import math

import pytest
from fmpy.model_description import BaseUnit, SimpleType, Unit
from hypothesis import given
from hypothesis import strategies as st
from support import refusals
from support.descriptions import description, variable

from orchestrator.fmi.variables import EXPONENTS, KNOWN, conversion, variables

WHERE = "The controller x.fmu: q_m[1]"
TORQUE = {"kg": 1, "m": 2, "s": -2}


def convert(unit, wanted, *definitions):
    return conversion(description([], definitions), unit, wanted, WHERE)


def refusal(unit, wanted, *definitions):
    error = refusals.refusal(convert, unit, wanted, *definitions)
    assert (error.where, error.value) == (WHERE, unit)
    return error.what


KNOWN_BY_NAME = {
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "°": ("rad", math.pi / 180),
    "ms": ("s", 1e-3),
    "N.m": ("N.m", 1.0),
    "Nm": ("N.m", 1.0),
    "mN.m": ("N.m", 1e-3),
    "kN.m": ("N.m", 1e3),
}


@pytest.mark.parametrize("unit", KNOWN_BY_NAME)
def test_units_known_by_name(unit):
    wanted, factor = KNOWN_BY_NAME[unit]
    assert convert(unit, wanted).factor == pytest.approx(factor, rel=1e-15)
    assert convert(unit, wanted).note == ""


def test_a_definition_overrides_the_name_unless_it_has_no_base_units():
    """An FMU that calls a milliradian "rad" has said so."""
    assert convert("rad", "rad", Unit("rad", BaseUnit(rad=1, factor=1e-3))).factor == 1e-3
    assert convert("deg", "rad", Unit("deg", None)).factor == pytest.approx(math.pi / 180)
    found = convert(None, "rad")
    assert found.factor == 1.0 and found.note == f"{WHERE} declares no unit; taken as rad"


@pytest.mark.parametrize(
    ("unit", "definitions", "factor"),
    [
        ("1", (), 1.0),
        ("rad", (Unit("rad", BaseUnit()),), 1.0),
        ("deg", (Unit("deg", BaseUnit(factor=math.pi / 180)),), math.pi / 180),
    ],
)
def test_an_angle_without_dimension_is_a_note(unit, definitions, factor):
    found = convert(unit, "rad", *definitions)
    assert found.factor == factor and "counts radians as dimensionless" in found.note


def turned(**base_unit):
    return (Unit("mine", BaseUnit(rad=1, **base_unit)),)


@pytest.mark.parametrize(
    ("what", "unit", "wanted", "definitions"),
    [
        *(("wrong-unit", *units, ()) for units in (("m", "rad"), ("rad", "N.m"), ("N", "N.m"), ("1", "N.m"))),
        ("wrong-unit", "deg", "rad", (Unit("deg", BaseUnit(K=1)),)),
        ("bad-unit", "deg", "rad", (Unit("deg", BaseUnit(rad=1)),)),  # the factor is missing
        ("bad-unit", "deg", "rad", (Unit("deg", BaseUnit()),)),
        ("bad-unit", "mN.m", "N.m", (Unit("mN.m", BaseUnit(**TORQUE)),)),
        ("wrong-unit", "N.m/deg", "N.m", (Unit("N.m/deg", BaseUnit(**TORQUE, rad=-1, factor=180 / math.pi)),)),
        *(("unknown-unit", unit, "rad", ()) for unit in ("rpm", "counts", "N.m/rad", "Rad")),
        ("unknown-unit", "furlong", "rad", (Unit("furlong", None),)),
        *(("bad-unit", "mine", "rad", turned(factor=factor)) for factor in (0.0, -1.0, math.nan, math.inf)),
        ("unit-offset", "mine", "rad", turned(offset=0.5)),  # its zero is not zero: a factor alone would be wrong
    ],
)
def test_units_that_do_not_fit_are_refused(what, unit, wanted, definitions):
    assert refusal(unit, wanted, *definitions) == what


WANTED = ("rad", "N.m", "N", "m", "s")
powers = st.one_of(
    st.sampled_from([KNOWN[name].exponents for name in WANTED]), st.tuples(*(st.integers(-2, 2) for _ in EXPONENTS))
)


@given(powers, st.floats(1e-6, 1e6), st.sampled_from(WANTED))
def test_only_units_of_the_same_kind_convert(powers, factor, wanted):
    definition = Unit("x", BaseUnit(**dict(zip(EXPONENTS, powers, strict=True)), factor=factor))
    if powers == KNOWN[wanted].exponents or (wanted == "rad" and not any(powers)):  # an angle is dimensionless in SI
        assert convert("x", wanted, definition).factor == factor
    else:
        assert refusal("x", wanted, definition) == "wrong-unit"


def test_the_unit_of_a_declared_type_counts():
    typed = variable("q_m[1]")
    typed.declaredType = SimpleType(name="Angle", type="Real", unit="deg")
    assert variables(description([typed]))["q_m[1]"].unit == "deg"
    typed.unit = "rad"
    assert variables(description([typed]))["q_m[1]"].unit == "rad"
