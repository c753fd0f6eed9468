"""Which variables of an FMU are bound to what by their spelling, and what is refused rather than guessed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.descriptions import description, pair, usual, variable
from support.refusals import refusal

from orchestrator.fmi.connectors import ARRAY, CONTROLLER, PLANT, Spelling, bind, bind_controller, canonical, spelling

WHAT = "The controller x.fmu"


def bound(shown, mapping=None):
    """Names of the variables by connector, and how they were found."""
    return {
        name: ([v.name for v in found.variables], found.spelled)
        for name, found in bind_controller(shown, WHAT, mapping).items()
    }


def array(name, size=2, kind="Float64"):
    return variable(name, kind=kind, size=size)


def both(template, causality="input", indices=(1, 2)):
    """The scalars of a connector by a template of their names: ``q_m[{}]``."""
    return pair([template.format(index) for index in indices], causality)


def refused(shown, mapping=None):
    """The error's code, its value and the nearest names."""
    error = refusal(bind_controller, shown, WHAT, mapping)
    assert error.where.startswith(WHAT)
    return error.what, error.value, error.nearest


def test_the_nearest_names_are_in_the_order_of_the_fmu():
    shown = description([*both("q_m[{}]"), *pair(("tau_A", "tau_B"), "output")])
    assert refused(shown) == ("connector-missing", "u_m", ("tau_A", "tau_B"))


def test_exact_scalars():
    further = [*both("q_m_ref[{}]"), *both("u_m0[{}]", "parameter"), *both("q_a_ref[{}]")]
    found = bind_controller(usual(*further), WHAT)
    assert set(found) == {"q_m", "u_m", "q_m_ref", "u_m0", "q_a_ref"}
    assert {own.spelled for own in found.values()} == {"exact"}
    assert found["u_m0"].is_parameter and not found["q_m_ref"].is_parameter
    assert set(bound(usual())) == {"q_m", "u_m"}, "the others are optional"


@pytest.mark.parametrize(
    ("inputs", "names", "spelled"),
    [
        ([array("q_m")], ["q_m"], "exact"),
        (both("q_m[{}]", indices=(0, 1)), ["q_m[0]", "q_m[1]"], "exact"),
        (both("q_m[{}]", indices=(2, 1)), ["q_m[1]", "q_m[2]"], "exact"),
        ([*both("Observer.q_m[{}]"), *both("qm{}"), *both("q_m[{}]")], ["q_m[1]", "q_m[2]"], "exact"),
        (both("QM{}", indices=(2, 1)), ["QM1", "QM2"], "by spelling"),
        (both("A.B.q_m_{}"), ["A.B.q_m_1", "A.B.q_m_2"], "by spelling"),
        (both("Controller.q_m[{}]", indices=(1, 0)), ["Controller.q_m[0]", "Controller.q_m[1]"], "by spelling"),
        ([array("Controller.q_m")], ["Controller.q_m"], "by spelling"),
        ([*both("q_m_{}"), *both("Log.q_m_{}", "output")], ["q_m_1", "q_m_2"], "by spelling"),
    ],
)
def test_names(inputs, names, spelled):
    assert bound(usual(*inputs, without="q_m"))["q_m"] == (names, spelled)


@pytest.mark.parametrize(
    ("inputs", "value"),
    [
        ([*both("Controller.q_m[{}]"), *both("Observer.q_m[{}]")], "q_m[1]"),
        (pair(("q_m_1", "qm1", "q_m_2")), "q_m[1]"),
        (pair(("q_m_1", "q_m_2", "qm2")), "q_m[1]"),
        ([array("P.q_m"), *both("q_m_{}")], "q_m"),
        ([array("q_m"), *both("q_m[{}]")], "q_m"),
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
        *(both(template, indices=range(3)) for template in ("q_m[{}]", "q_m_{}", "q_m.axis{}")),
        both("q_m[{}]", indices=(1, 2, 3)),
        [array("q_m", 3)],
        [array("q_m", 6)],
    ],
)
def test_two_elements_are_needed(inputs):
    names = ", ".join(one.name for one in inputs)
    assert refused(usual(*inputs, without="q_m"))[:2] == ("connector-size", names)


@pytest.mark.parametrize(
    ("missing", "names"), [("q_m", ("In1", "In2")), *(("u_m", (name,)) for name in ("y", "u_m[1]", "u_m_2", "u_m"))]
)
def test_a_missing_connector_is_reported_with_what_there_is(missing, names):
    there = pair(names, "input" if missing == "q_m" else "output")
    what, value, near = refused(usual(*there, without=missing))
    assert (what, value, set(near)) == ("connector-missing", missing, set(names))


def test_the_plant_needs_all_its_connectors():
    rows = [v for c in PLANT if c.name != "u_d" for v in pair(c.components(), c.causalities[0], c.unit)]
    error = refusal(bind, description(rows), PLANT, "The plant")
    assert (error.what, error.value) == ("connector-missing", "u_d")


@pytest.mark.parametrize(
    ("name", "causality", "kind"),
    [
        *(("q_m", causality, "Real") for causality in ("output", "parameter")),
        *(("q_m", "input", kind) for kind in ("Integer", "Boolean", "Int32")),
        *(("u_m", causality, "Real") for causality in ("input", "local")),
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


@pytest.mark.parametrize(
    ("without", "further", "connectors"),
    [
        ("q_m", ("e",), {"u_m", "e"}),
        ("q_m", ("e", "q_m_ref"), {"u_m", "e", "q_m_ref"}),
        ("", ("e", "q_m_ref"), {"u_m", "q_m", "q_m_ref"}),
    ],
)
def test_the_position_error_may_take_the_place_of_the_angles(without, further, connectors):
    inputs = [one for name in further for one in both(f"{name}[{{}}]")]
    assert set(bound(usual(*inputs, without=without))) == connectors
    what = "angles and error need a reference"
    assert refused(usual(*both("e[{}]")))[:2] == ("connector-missing", "q_m_ref"), what


@pytest.mark.parametrize(
    ("inputs", "mapping", "names"),
    [
        (pair(["In2", "In1"]), {"q_m[1]": "In1", "q_m[2]": "In2"}, ["In1", "In2"]),
        ([array("Measured", kind="Float32")], {"q_m": "Measured"}, ["Measured"]),
        (both("q_m[{}]"), {"q_m[1]": "q_m[2]", "q_m[2]": "q_m[1]"}, ["q_m[2]", "q_m[1]"]),
    ],
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


def test_factors_notes_and_values_of_a_binding():
    shown = description([*pair(["q_m[1]", "q_m[2]"], "input", "deg"), *both("u_m[{}]", "output")])
    found = bind_controller(shown, WHAT)
    assert found["q_m"].factors == pytest.approx((0.017453292519943295,) * 2, rel=1e-15)
    assert (found["q_m"].notes, found["u_m"].factors) == ((), (1.0, 1.0))
    assert found["u_m"].notes == tuple(f"{WHAT}: u_m[{i}] declares no unit; taken as N.m" for i in (1, 2))
    values = found["q_m"].values((0.017453292519943295, -0.03490658503988659))
    assert [(v.name, value) for v, value in values.items()] == [("q_m[1]", [1.0]), ("q_m[2]", [-2.0])]
    other = usual(*pair(["q_m[1]", "q_m[2]"], "input", "m"), without="q_m")
    assert refused(other)[:2] == ("wrong-unit", "m")


CONNECTORS = sorted({connector.name for connector in (*CONTROLLER, *PLANT)})

INDEXED = ("{name}[{index}]", "{name}_{index}", "{name}{index}", "{name}.axis{index}", "{name}.axis_{index}")
INDEXED += ("{name}_axis{index}", "{name}.joint{index}", "{name}({index})", "{name}.{index}", "{name}__{index}_")

names = st.sampled_from(CONNECTORS)
indices = st.integers(1, 2)
paths = st.lists(st.sampled_from(["Controller", "pid", "a.b", "Sub_2", "q_m", "axis1"]), max_size=2)
cases = st.sampled_from([str, str.upper, str.lower, str.title])


@pytest.mark.parametrize("name", ["q_m", "time", "[1]", "1", "", "q_m[1].x", "q_m_1_raw", "axis1", "position", "..."])
def test_names_without_an_index_are_no_component(name):
    assert spelling(name, array=False) is None


@given(names, indices, st.sampled_from(INDEXED), paths, cases)
def test_every_connector_is_known_in_every_spelling(name, index, template, path, case):
    spelled = ".".join([*path, case(template.format(name=name, index=index))])
    assert spelling(spelled, array=False) == Spelling(canonical(name), index)


@given(names, st.booleans(), paths, cases)
def test_arrays_have_no_index(name, joined, path, case):
    spelled = ".".join([*path, case(name.replace("_", "") if joined else name)])
    assert spelling(spelled, array=True) == spelling(name, array=True) == Spelling(canonical(name), ARRAY)


@given(names, names, indices, indices, st.sampled_from(INDEXED), st.sampled_from(INDEXED))
def test_two_connectors_or_components_never_spell_the_same(first, second, i, j, template, other):
    one = spelling(template.format(name=first, index=i), array=False)
    two = spelling(other.format(name=second, index=j), array=False)
    assert (one == two) == ((first, i) == (second, j))


@given(st.text(), st.booleans())
def test_any_text_has_a_spelling_or_none(text, array):
    found = spelling(text, array)
    assert found is None or found.index in (ARRAY, *range(10))
