"""Units at a connection: by base units where they are defined, by name where they are known, never silently."""

from __future__ import annotations

import math

import pytest
from fmpy.model_description import BaseUnit, SimpleType, Unit
from hypothesis import given
from hypothesis import strategies as st
from support import refusals
from support.descriptions import description, variable

from orchestrator.fmi.units import EXPONENTS, KNOWN, conversion
from orchestrator.fmi.variables import variables

WHERE = "The controller x.fmu: q_m[1]"
TORQUE = {"kg": 1, "m": 2, "s": -2}


def convert(unit, wanted, *definitions):
    return conversion(description([], definitions), unit, wanted, WHERE)


def refusal(unit, wanted, *definitions):
    error = refusals.refusal(convert, unit, wanted, *definitions)
    assert (error.where, error.value) == (WHERE, unit)
    return error.what


@pytest.mark.parametrize(
    ("unit", "wanted", "factor"),
    [
        ("rad", "rad", 1.0),
        ("deg", "rad", math.pi / 180),
        ("°", "rad", math.pi / 180),
        ("N.m", "N.m", 1.0),
        ("Nm", "N.m", 1.0),
        ("mN.m", "N.m", 1e-3),
        ("kN.m", "N.m", 1e3),
        ("ms", "s", 1e-3),
    ],
)
def test_units_known_by_name(unit, wanted, factor):
    assert convert(unit, wanted).factor == pytest.approx(factor, rel=1e-15)
    assert convert(unit, wanted).note == ""


@pytest.mark.parametrize(
    ("definition", "wanted", "factor"),
    [
        (Unit("grad", BaseUnit(rad=1, factor=math.pi / 200)), "rad", math.pi / 200),
        (Unit("lbf.ft", BaseUnit(**TORQUE, factor=1.3558179483314004)), "N.m", 1.3558179483314004),
        (Unit("J", BaseUnit(**TORQUE)), "N.m", 1.0),
        (Unit("rad", BaseUnit(rad=1)), "rad", 1.0),
    ],
)
def test_units_are_understood_by_their_base_units(definition, wanted, factor):
    assert convert(definition.name, wanted, definition).factor == factor


def test_a_definition_overrides_the_name():
    """An FMU that calls a milliradian "rad" has said so."""
    assert convert("rad", "rad", Unit("rad", BaseUnit(rad=1, factor=1e-3))).factor == 1e-3
    assert refusal("deg", "rad", Unit("deg", BaseUnit(K=1))) == "wrong-unit"


def test_a_definition_without_base_units_leaves_the_name():
    assert convert("deg", "rad", Unit("deg", None)).factor == pytest.approx(math.pi / 180)
    assert refusal("furlong", "rad", Unit("furlong", None)) == "unknown-unit"


def test_a_missing_unit_is_a_note():
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


@pytest.mark.parametrize("factor", [0.0, -1.0, math.nan, math.inf])
def test_a_factor_must_be_a_positive_number(factor):
    assert refusal("mine", "rad", Unit("mine", BaseUnit(rad=1, factor=factor))) == "bad-unit"


@pytest.mark.parametrize(
    ("unit", "wanted", "definitions"),
    [
        ("m", "rad", ()),
        ("rad", "N.m", ()),
        ("N", "N.m", ()),
        ("1", "N.m", ()),
        ("N.m/deg", "N.m", (Unit("N.m/deg", BaseUnit(**TORQUE, rad=-1, factor=180 / math.pi)),)),
        ("V", "N.m", (Unit("V", BaseUnit(kg=1, m=2, s=-3, A=-1)),)),
        ("rad/s", "rad", (Unit("rad/s", BaseUnit(rad=1, s=-1)),)),
    ],
)
def test_a_unit_of_another_kind_is_refused(unit, wanted, definitions):
    assert refusal(unit, wanted, *definitions) == "wrong-unit"


@pytest.mark.parametrize("unit", ["rpm", "counts", "N.m/rad", "Rad"])
def test_an_unknown_unit_is_refused(unit):
    assert refusal(unit, "rad") == "unknown-unit"


def test_a_unit_with_an_offset_is_refused():
    """Its zero is not zero: a factor alone would be wrong."""
    shifted = Unit("turned", BaseUnit(rad=1, offset=0.5))
    assert refusal("turned", "rad", shifted) == "unit-offset"


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
