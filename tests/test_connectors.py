"""Which variables of an FMU are bound to what, and what is refused rather than guessed."""

from __future__ import annotations

import pytest
from support.descriptions import description, pair, usual, variable
from support.refusals import refusal

from orchestrator.fmi.connectors import PLANT, bind, bind_controller

WHAT = "The controller x.fmu"


def bound(shown, mapping=None):
    """Names of the variables by connector, and how they were found."""
    return {
        name: ([v.name for v in found.variables], found.spelled)
        for name, found in bind_controller(shown, WHAT, mapping).items()
    }


def array(name, size=2, causality="input", kind="Float64"):
    return variable(name, causality, kind=kind, size=size)


def refused(shown, mapping=None):
    """The error's code, its value and the nearest names."""
    error = refusal(bind_controller, shown, WHAT, mapping)
    assert error.where.startswith(WHAT)
    return error.what, error.value, error.nearest


# ---- Exact names ----


def test_exact_scalars():
    further = [*pair(["q_m_ref[1]", "q_m_ref[2]"]), *pair(["u_m0[1]", "u_m0[2]"], "parameter")]
    found = bind_controller(usual(*further, *pair(["q_a_ref[1]", "q_a_ref[2]"])), WHAT)
    assert set(found) == {"q_m", "u_m", "q_m_ref", "u_m0", "q_a_ref"}
    assert {own.spelled for own in found.values()} == {"exact"}
    assert found["u_m0"].is_parameter and not found["q_m_ref"].is_parameter
    assert set(bound(usual())) == {"q_m", "u_m"}, "the others are optional"


@pytest.mark.parametrize(
    ("inputs", "names"),
    [
        ([array("q_m")], ["q_m"]),
        (pair(["q_m[0]", "q_m[1]"]), ["q_m[0]", "q_m[1]"]),
        (pair(["q_m[2]", "q_m[1]"]), ["q_m[1]", "q_m[2]"]),
        (pair(["Observer.q_m[1]", "Observer.q_m[2]", "qm1", "qm2", "q_m[1]", "q_m[2]"]), ["q_m[1]", "q_m[2]"]),
    ],
    ids=["array", "zero-based", "any order", "before what is spelled so"],
)
def test_exact_names(inputs, names):
    assert bound(usual(*inputs, without="q_m"))["q_m"] == (names, "exact")


# ---- Spelling ----


@pytest.mark.parametrize(
    "names",
    [
        ("q_m_1", "q_m_2"),
        ("QM1", "QM2"),
        ("q_m.axis1", "q_m.axis2"),
        ("A.B.q_m_1", "A.B.q_m_2"),
        ("q_m_0", "q_m_1"),
        ("Controller.q_m[0]", "Controller.q_m[1]"),
    ],
)
def test_spelled_scalars(names):
    assert bound(usual(*pair(names[::-1]), without="q_m"))["q_m"] == (list(names), "by spelling")


@pytest.mark.parametrize("name", ["qm", "Controller.q_m", "Q_m"])
def test_spelled_arrays(name):
    assert bound(usual(array(name), without="q_m"))["q_m"] == ([name], "by spelling")


def test_a_variable_of_another_causality_is_no_candidate_by_spelling():
    shown = usual(*pair(["q_m_1", "q_m_2"]), *pair(["Log.q_m_1", "Log.q_m_2"], "output"), without="q_m")
    assert bound(shown)["q_m"][0] == ["q_m_1", "q_m_2"]


# ---- What is never guessed ----


@pytest.mark.parametrize(
    ("inputs", "value"),
    [
        (pair(("Controller.q_m[1]", "Controller.q_m[2]", "Observer.q_m[1]", "Observer.q_m[2]")), "q_m[1]"),
        (pair(("q_m_1", "qm1", "q_m_2")), "q_m[1]"),
        (pair(("q_m_1", "q_m_2", "qm2")), "q_m[1]"),
        ([array("P.q_m"), *pair(("q_m_1", "q_m_2"))], "q_m"),
        ([array("q_m"), *pair(("q_m[1]", "q_m[2]"))], "q_m"),
    ],
)
def test_two_candidates_are_refused_and_named(inputs, value):
    what, given, nearest = refused(usual(*inputs, without="q_m"))
    assert (what, given) == ("connector-ambiguous", value)
    assert sorted(nearest) == sorted(one.name for one in inputs)
    assert bound(usual(*inputs, without="q_m"), {"q_m[1]": inputs[-2].name, "q_m[2]": inputs[-1].name})


@pytest.mark.parametrize(
    ("name", "connector"),
    [("q_m_ref[2]", "q_m_ref"), ("qmref1", "q_m_ref"), ("u_m0[1]", "u_m0"), ("q_a_ref_0", "q_a_ref")],
)
def test_half_an_optional_connector_is_not_an_absent_one(name, connector):
    assert refused(usual(variable(name))) == ("connector-half", connector, (name,))


@pytest.mark.parametrize(
    "inputs",
    [
        pair(("q_m[1]", "q_m[2]", "q_m[3]")),
        pair(("q_m[0]", "q_m[1]", "q_m[2]")),
        pair(("q_m_1", "q_m_2", "q_m_3")),
        pair(("q_m_0", "q_m_1", "q_m_2")),
        pair(("q_m.axis1", "q_m.axis2", "q_m.axis3")),
        [array("q_m", 3)],
        [array("q_m", 6)],
    ],
)
def test_two_elements_are_needed(inputs):
    names = ", ".join(one.name for one in inputs)
    assert refused(usual(*inputs, without="q_m"))[:2] == ("connector-size", names)


# ---- What is missing ----


@pytest.mark.parametrize(
    ("missing", "there", "nearest"),
    [
        ("q_m", pair(["In1", "In2"]), ("In1", "In2")),
        ("u_m", pair(["y[1]", "y[2]"], "output"), ("y[1]", "y[2]")),
        ("u_m", pair(["u_m[1]"], "output"), ("u_m[1]",)),
        ("u_m", pair(["u_m_2"], "output"), ("u_m_2",)),
        ("u_m", pair(["u_m"], "output"), ("u_m",)),
        ("u_m", [], ()),
    ],
)
def test_a_missing_connector_is_reported_with_what_there_is(missing, there, nearest):
    what, value, near = refused(usual(*there, without=missing))
    assert (what, value, set(near)) == ("connector-missing", missing, set(nearest))


def test_the_plant_needs_all_its_connectors():
    rows = [v for c in PLANT if c.name != "u_d" for v in pair(c.components(), c.causalities[0], c.unit)]
    error = refusal(bind, description(rows), PLANT, "The plant")
    assert (error.what, error.value) == ("connector-missing", "u_d")


# ---- Wrong declarations ----


@pytest.mark.parametrize(
    ("name", "causality", "kind"),
    [
        ("q_m", "output", "Real"),
        ("q_m", "parameter", "Real"),
        ("q_m", "input", "Integer"),
        ("q_m", "input", "Boolean"),
        ("q_m", "input", "Int32"),
        ("u_m", "input", "Real"),
        ("u_m", "local", "Real"),
        ("u_m", "output", "Integer"),
    ],
)
def test_wrong_causality_or_type_is_refused(name, causality, kind):
    wrong = [variable(f"{name}[{i}]", causality, kind=kind) for i in (1, 2)]
    assert refused(usual(*wrong, without=name))[:2] == ("connector-type", f"{name}[1]")


@pytest.mark.parametrize(
    ("first", "second", "value"), [("Real", "Integer", "q_m[2]"), ("Float64", "Float32", "q_m[1]")]
)
def test_both_components_have_one_real_type(first, second, value):
    shown = usual(variable("q_m[1]", kind=first), variable("q_m[2]", kind=second), without="q_m")
    assert refused(shown)[:2] == ("connector-type", value)


# ---- The position error instead ----


@pytest.mark.parametrize(
    ("without", "further", "connectors"),
    [
        ("q_m", ("e",), {"u_m", "e"}),
        ("q_m", ("e", "q_m_ref"), {"u_m", "e", "q_m_ref"}),
        ("", ("e", "q_m_ref"), {"u_m", "q_m", "q_m_ref"}),
    ],
)
def test_the_position_error_may_take_the_place_of_the_angles(without, further, connectors):
    inputs = [one for name in further for one in pair([f"{name}[1]", f"{name}[2]"])]
    assert set(bound(usual(*inputs, without=without))) == connectors


def test_angles_and_error_without_a_reference_are_refused():
    assert refused(usual(*pair(["e[1]", "e[2]"])))[:2] == ("connector-missing", "q_m_ref")


# ---- Mappings ----


@pytest.mark.parametrize(
    ("inputs", "mapping", "names"),
    [
        (pair(["In2", "In1"]), {"q_m[1]": "In1", "q_m[2]": "In2"}, ["In1", "In2"]),
        ([array("Measured", kind="Float32")], {"q_m": "Measured"}, ["Measured"]),
        (pair(["q_m[1]", "q_m[2]"]), {"q_m[1]": "q_m[2]", "q_m[2]": "q_m[1]"}, ["q_m[2]", "q_m[1]"]),
    ],
    ids=["scalars", "array", "crossed"],
)
def test_a_mapping_overrides_names(inputs, mapping, names):
    assert bound(usual(*inputs, without="q_m"), mapping)["q_m"] == (names, "mapped")


@pytest.mark.parametrize(
    ("mapping", "what", "value"),
    [
        ({"q_n[1]": "In1"}, "no-connector", "q_n[1]"),
        ({"q_m[3]": "In1"}, "no-connector", "q_m[3]"),
        ({"q_m[1]": "In7"}, "no-variable", "In7"),
        ({"q_m[1]": "In1"}, "bad-mapping", "q_m"),
        ({"q_m": "In1"}, "connector-size", "In1"),
        ({"q_m[1]": "In1", "q_m[2]": "u_m[1]"}, "connector-type", "u_m[1]"),
        ({"q_m[1]": "q_m[1]", "q_m[2]": "q_m[1]"}, "bad-mapping", "q_m[1]"),
        ({"q_m[1]": "In1", "q_m[2]": "In2", "q_m_ref[1]": "In2", "q_m_ref[2]": "In1"}, "bad-mapping", "In2"),
    ],
)
def test_wrong_mappings_are_refused(mapping, what, value):
    assert refused(usual(*pair(["In1", "In2"])), mapping)[:2] == (what, value)


def test_what_is_mapped_is_not_found_for_another_connector():
    """A controller whose inputs named q_m are the error: nothing but the mapping can know."""
    found = bound(usual(), {"e[1]": "q_m[1]", "e[2]": "q_m[2]"})
    assert found == {"u_m": (["u_m[1]", "u_m[2]"], "exact"), "e": (["q_m[1]", "q_m[2]"], "mapped")}


# ---- Units at a connection ----


def test_factors_notes_and_values_of_a_binding():
    shown = description([*pair(["q_m[1]", "q_m[2]"], "input", "deg"), *pair(["u_m[1]", "u_m[2]"], "output", None)])
    found = bind_controller(shown, WHAT)
    assert found["q_m"].factors == pytest.approx((0.017453292519943295,) * 2, rel=1e-15)
    assert (found["q_m"].notes, found["u_m"].factors) == ((), (1.0, 1.0))
    assert found["u_m"].notes == tuple(f"{WHAT}: u_m[{i}] declares no unit; taken as N.m" for i in (1, 2))
    values = found["q_m"].values((0.017453292519943295, -0.03490658503988659))
    assert [(v.name, value) for v, value in values.items()] == [("q_m[1]", [1.0]), ("q_m[2]", [-2.0])]


def test_a_unit_of_another_kind_is_refused():
    shown = usual(*pair(["q_m[1]", "q_m[2]"], "input", "m"), without="q_m")
    assert refused(shown)[:2] == ("wrong-unit", "m")
