"""Which variables of an FMU are bound to what, and what is refused rather than guessed."""

from __future__ import annotations

import pytest
from descriptions import description, pair, usual, variable

from orchestrator.cosim.connectors import PLANT, bind, bind_controller
from orchestrator.errors import InputError

WHAT = "The controller x.fmu"


def bound(shown, mapping=None):
    """Names of the variables by connector, and how they were found."""
    return {
        name: ([v.name for v in found.variables], found.spelled)
        for name, found in bind_controller(shown, WHAT, mapping).items()
    }


def refusal(shown, mapping=None):
    with pytest.raises(InputError) as caught:
        bind_controller(shown, WHAT, mapping)
    return str(caught.value)


# ---- Exact names ----


def test_exact_scalars():
    further = [*pair(["q_m_ref[1]", "q_m_ref[2]"]), *pair(["u_m0[1]", "u_m0[2]"], "parameter")]
    found = bind_controller(usual(*further, *pair(["q_a_ref[1]", "q_a_ref[2]"])), WHAT)
    assert set(found) == {"q_m", "u_m", "q_m_ref", "u_m0", "q_a_ref"}
    assert {own.spelled for own in found.values()} == {"exact"}
    assert found["u_m0"].is_parameter and not found["q_m_ref"].is_parameter


def test_optional_connectors_may_be_absent():
    assert set(bound(usual())) == {"q_m", "u_m"}


def test_exact_arrays():
    shown = description([variable("q_m", kind="Float64", size=2), variable("u_m", "output", kind="Float64", size=2)])
    assert bound(shown) == {"q_m": (["q_m"], "exact"), "u_m": (["u_m"], "exact")}


def test_zero_based_scalars():
    shown = usual(*pair(["q_m[0]", "q_m[1]"]), without="q_m")
    assert bound(shown)["q_m"] == (["q_m[0]", "q_m[1]"], "exact")


def test_order_of_declaration_does_not_count():
    shown = description(
        [*pair(["u_m[2]", "u_m[1]"], "output"), *pair(["q_m_2", "q_m_1"]), *pair(["u_m0[1]", "u_m0[0]"])]
    )
    assert [names for names, _ in bound(shown).values()] == [
        ["q_m_1", "q_m_2"],
        ["u_m[1]", "u_m[2]"],
        ["u_m0[0]", "u_m0[1]"],
    ]


def test_the_exact_name_goes_above_a_spelled_one():
    shown = usual(*pair(["Observer.q_m[1]", "Observer.q_m[2]", "qm1", "qm2"]))
    assert bound(shown)["q_m"] == (["q_m[1]", "q_m[2]"], "exact")


# ---- Spelling ----


@pytest.mark.parametrize(
    "names",
    [
        ("q_m_1", "q_m_2"),
        ("q_m1", "q_m2"),
        ("qm1", "qm2"),
        ("QM1", "QM2"),
        ("q_m.axis1", "q_m.axis2"),
        ("Controller.q_m[1]", "Controller.q_m[2]"),
        ("A.B.q_m_1", "A.B.q_m_2"),
        ("q_m_0", "q_m_1"),
        ("Controller.q_m[0]", "Controller.q_m[1]"),
    ],
)
def test_spelled_scalars(names):
    assert bound(usual(*pair(names), without="q_m"))["q_m"] == (list(names), "by spelling")


@pytest.mark.parametrize("name", ["qm", "Controller.q_m", "Q_m"])
def test_spelled_arrays(name):
    shown = usual(variable(name, kind="Float64", size=2), without="q_m")
    assert bound(shown)["q_m"] == ([name], "by spelling")


def test_a_variable_of_another_causality_is_no_candidate_by_spelling():
    shown = usual(*pair(["q_m_1", "q_m_2"]), *pair(["Log.q_m_1", "Log.q_m_2"], "output"), without="q_m")
    assert bound(shown)["q_m"][0] == ["q_m_1", "q_m_2"]


# ---- What is never guessed ----


@pytest.mark.parametrize(
    "names",
    [
        ("Controller.q_m[1]", "Controller.q_m[2]", "Observer.q_m[1]", "Observer.q_m[2]"),
        ("q_m_1", "qm1", "q_m_2"),
        ("q_m_1", "q_m_2", "qm2"),
    ],
)
def test_two_candidates_are_refused_and_named(names):
    message = refusal(usual(*pair(names), without="q_m"))
    assert "more than one candidate for q_m" in message and "--map q_m[1]=" in message
    assert all(name in message for name in names)


def test_an_array_and_scalars_are_two_candidates():
    shown = usual(*pair(["q_m_1", "q_m_2"]), variable("P.q_m", kind="Float64", size=2), without="q_m")
    assert "--map q_m=P.q_m" in refusal(shown)


def test_an_array_and_scalars_of_the_exact_name_are_two_candidates():
    shown = usual(variable("q_m", kind="Float64", size=2))
    assert "more than one candidate for q_m: q_m, q_m[1], q_m[2]. Say which, such as --map q_m=q_m" in refusal(shown)
    assert bound(shown, {"q_m": "q_m"})["q_m"] == (["q_m"], "mapped")


@pytest.mark.parametrize("name", ["q_m_ref[2]", "qmref1", "u_m0[1]", "q_a_ref_0"])
def test_half_an_optional_connector_is_no_absent_one(name):
    message = refusal(usual(variable(name)))
    assert f"has {name}, but not the other component" in message and "--map" in message


def test_two_candidates_of_an_optional_connector_are_refused_too():
    assert "q_m_ref" in refusal(usual(*pair(["a.q_m_ref_1", "a.q_m_ref_2", "b.q_m_ref_1", "b.q_m_ref_2"])))


@pytest.mark.parametrize(
    "names",
    [
        ("q_m[1]", "q_m[2]", "q_m[3]"),
        ("q_m[0]", "q_m[1]", "q_m[2]"),
        ("q_m_1", "q_m_2", "q_m_3"),
        ("q_m_0", "q_m_1", "q_m_2"),
        ("q_m.axis1", "q_m.axis2", "q_m.axis3"),
    ],
)
def test_a_third_component_is_refused(names):
    message = refusal(usual(*pair(names), without="q_m"))
    assert "has 3 elements, but q_m needs 2" in message and names[2] in message


@pytest.mark.parametrize("size", [3, 6])
def test_an_array_of_another_size_is_refused(size):
    shown = usual(variable("q_m", kind="Float64", size=size), without="q_m")
    assert f"q_m has {size} elements, but q_m needs 2" in refusal(shown)


# ---- What is missing ----


def test_a_missing_input_is_told_with_what_there_is():
    message = refusal(usual(*pair(["In1", "In2"]), without="q_m"))
    assert "has no input q_m[1], q_m[2] [rad] (measured motor angles)" in message
    assert "Nearest: In1, In2" in message and "--map q_m[1]=NAME --map q_m[2]=NAME" in message


def test_a_missing_output_is_told_with_what_there_is():
    message = refusal(usual(*pair(["y[1]", "y[2]"], "output"), without="u_m"))
    assert "has no output u_m[1], u_m[2] [N.m] (motor torques to command)" in message and "y[1], y[2]" in message


@pytest.mark.parametrize("there", ["u_m[1]", "u_m[2]", "u_m_1", "u_m"])
def test_half_an_output_is_missing(there):
    assert "has no output u_m[1], u_m[2]" in refusal(usual(variable(there, "output"), without="u_m"))


def test_nothing_at_all_is_missing_too():
    assert "Nearest: none" in refusal(description([]))


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
    message = refusal(usual(*wrong, without=name))
    assert f"{name}[1] is declared as {kind}, {causality}" in message and "must be a real" in message


def test_one_wrong_component_is_enough():
    message = refusal(usual(variable("q_m[1]"), variable("q_m[2]", kind="Integer"), without="q_m"))
    assert "q_m[2] is declared as Integer" in message


def test_single_and_double_precision_are_not_mixed():
    shown = usual(variable("q_m[1]", kind="Float64"), variable("q_m[2]", kind="Float32"), without="q_m")
    assert "differ in type" in refusal(shown)


# ---- The position error instead ----


def test_the_position_error_may_take_the_place_of_the_angles():
    found = bound(usual(*pair(["e[1]", "e[2]"]), without="q_m"))
    assert set(found) == {"u_m", "e"}


def test_error_and_reference_may_come_together():
    found = bound(usual(*pair(["e[1]", "e[2]", "q_m_ref[1]", "q_m_ref[2]"]), without="q_m"))
    assert set(found) == {"u_m", "e", "q_m_ref"}


def test_with_angles_and_reference_the_error_is_not_fed():
    found = bound(usual(*pair(["e[1]", "e[2]", "q_m_ref[1]", "q_m_ref[2]"])))
    assert set(found) == {"u_m", "q_m", "q_m_ref"}


def test_angles_and_error_without_a_reference_are_refused():
    assert "has both inputs, q_m and e, but no q_m_ref" in refusal(usual(*pair(["e[1]", "e[2]"])))


# ---- Mappings ----


def test_mapped_scalars():
    shown = usual(*pair(["In2", "In1"]), without="q_m")
    assert bound(shown, {"q_m[1]": "In1", "q_m[2]": "In2"})["q_m"] == (["In1", "In2"], "mapped")


def test_mapped_array():
    shown = usual(variable("Measurements", kind="Float32", size=2), without="q_m")
    assert bound(shown, {"q_m": "Measurements"})["q_m"] == (["Measurements"], "mapped")


def test_a_mapping_decides_between_two_candidates():
    names = ("Controller.q_m[1]", "Controller.q_m[2]", "Observer.q_m[1]", "Observer.q_m[2]")
    found = bound(usual(*pair(names), without="q_m"), {f"q_m[{i}]": f"Observer.q_m[{i}]" for i in (1, 2)})
    assert found["q_m"] == (["Observer.q_m[1]", "Observer.q_m[2]"], "mapped")


def test_a_mapping_goes_above_the_exact_name_and_may_cross():
    found = bound(usual(), {"q_m[1]": "q_m[2]", "q_m[2]": "q_m[1]"})
    assert found["q_m"] == (["q_m[2]", "q_m[1]"], "mapped")


@pytest.mark.parametrize(
    ("mapping", "told"),
    [
        ({"q_n[1]": "In1"}, "The mapping names q_n[1], which is no connector. Nearest: q_m[1]"),
        ({"q_m[3]": "In1"}, "The mapping names q_m[3], which is no connector"),
        ({"q_m[1]": "In7"}, "has no variable In7, to which q_m[1] is mapped. Nearest: In"),
        ({"q_m[1]": "In1"}, "only one of q_m[1] and q_m[2]. Give both"),
        ({"q_m": "In1"}, "In1 has 1 elements, but q_m needs 2"),
        ({"q_m[1]": "In1", "q_m[2]": "u_m[1]"}, "u_m[1] is declared as Real, output"),
        ({"q_m[1]": "q_m[1]", "q_m[2]": "q_m[1]"}, "has q_m[1] for both q_m[1] and q_m[2]"),
        (
            {"q_m[1]": "In1", "q_m[2]": "In2", "q_m_ref[1]": "In2", "q_m_ref[2]": "In1"},
            "has In2 for both q_m[2] and q_m_ref[1]",
        ),
    ],
)
def test_wrong_mappings_are_refused(mapping, told):
    assert told in refusal(usual(*pair(["In1", "In2"])), mapping)


def test_what_is_mapped_is_not_found_for_another_connector():
    """A controller whose inputs named q_m are the error: nothing but the mapping can know."""
    found = bound(usual(), {"e[1]": "q_m[1]", "e[2]": "q_m[2]"})
    assert found == {"u_m": (["u_m[1]", "u_m[2]"], "exact"), "e": (["q_m[1]", "q_m[2]"], "mapped")}


# ---- Units at a connection ----


def test_factors_and_notes_stand_in_the_binding():
    shown = description([*pair(["q_m[1]", "q_m[2]"], "input", "deg"), *pair(["u_m[1]", "u_m[2]"], "output", None)])
    found = bind_controller(shown, WHAT)
    assert found["q_m"].factors == pytest.approx((0.017453292519943295,) * 2, rel=1e-15)
    assert found["q_m"].notes == ()
    assert found["u_m"].factors == (1.0, 1.0)
    assert found["u_m"].notes == tuple(f"{WHAT}: u_m[{i}] declares no unit; taken as N.m" for i in (1, 2))


def test_values_go_into_the_fmus_units():
    found = bind_controller(usual(*pair(["q_m_ref[1]", "q_m_ref[2]"], "input", "deg")), WHAT)["q_m_ref"]
    values = found.values((0.017453292519943295, -0.03490658503988659))
    assert [(v.name, value) for v, value in values.items()] == [("q_m_ref[1]", [1.0]), ("q_m_ref[2]", [-2.0])]


def test_a_unit_of_another_kind_is_refused():
    assert "q_m[1] has the unit 'm', which is no rad" in refusal(
        usual(*pair(["q_m[1]", "q_m[2]"], "input", "m"), without="q_m")
    )


# ---- The plant's side ----


def test_the_plant_needs_all_its_connectors():
    rows = [
        v
        for connector in PLANT
        for v in pair(connector.components(), connector.causalities[0], connector.unit)
        if connector.name != "u_d"
    ]
    with pytest.raises(InputError, match=r"The plant has no input u_d\[1\], u_d\[2\] \[N.m\]"):
        bind(description(rows), PLANT, "The plant")
