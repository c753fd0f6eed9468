"""The spelling of names: everything that means ``q_m[1]``, and nothing else."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from orchestrator.fmi.connectors import CONTROLLER, PLANT
from orchestrator.fmi.names import ARRAY, Spelling, canonical, spelling, zero_based

CONNECTORS = sorted({connector.name for connector in (*CONTROLLER, *PLANT)})

INDEXED = ("{name}[{index}]", "{name}_{index}", "{name}{index}", "{name}.axis{index}", "{name}.axis_{index}")
INDEXED += ("{name}_axis{index}", "{name}.joint{index}", "{name}({index})", "{name}.{index}", "{name}__{index}_")

names = st.sampled_from(CONNECTORS)
indices = st.integers(1, 2)
paths = st.lists(st.sampled_from(["Controller", "pid", "a.b", "Sub_2", "q_m", "axis1"]), max_size=2)
cases = st.sampled_from([str, str.upper, str.lower, str.title])


@pytest.mark.parametrize(
    "name", ["q_m[1]", "q_m_1", "q_m1", "qm1", "q_m.axis1", "Controller.q_m[1]", "QM_1", "Q_m_Axis_1", "q_m[ 1 ]"]
)
def test_spellings_of_the_first_motor_angle(name):
    assert spelling(name, array=False) == Spelling("qm", 1)


@pytest.mark.parametrize("name", ["q_m", "time", "[1]", "1", "", "q_m[1].x", "q_m_1_raw", "axis1", "position", "..."])
def test_names_without_an_index_are_no_component(name):
    assert spelling(name, array=False) is None


@pytest.mark.parametrize(
    ("name", "connector"), [("q_m_ref[1]", "q_m"), ("u_m0[1]", "u_m"), ("dq_m[1]", "q_m"), ("q_m_ref1", "q_m")]
)
def test_a_longer_name_is_another_connector(name, connector):
    found = spelling(name, array=False)
    assert found is not None and found.base != canonical(connector)


@given(names, indices, st.sampled_from(INDEXED), paths, cases)
def test_every_connector_is_known_in_every_spelling(name, index, template, path, case):
    spelled = ".".join([*path, case(template.format(name=name, index=index))])
    assert spelling(spelled, array=False) == Spelling(canonical(name), index)


@given(names, st.booleans(), paths, cases)
def test_arrays_have_no_index(name, joined, path, case):
    spelled = ".".join([*path, case(name.replace("_", "") if joined else name)])
    assert spelling(spelled, array=True) == Spelling(canonical(name), ARRAY)


@given(names, names, indices, indices, st.sampled_from(INDEXED), st.sampled_from(INDEXED))
def test_two_connectors_or_components_never_spell_the_same(first, second, i, j, template, other):
    one = spelling(template.format(name=first, index=i), array=False)
    two = spelling(other.format(name=second, index=j), array=False)
    assert (one == two) == ((first, i) == (second, j))


@given(st.text(), st.booleans())
def test_any_text_has_a_spelling_or_none(text, array):
    found = spelling(text, array)
    assert found is None or found.index in (ARRAY, *range(10))


@given(names)
def test_a_connectors_own_name_is_its_array(name):
    assert spelling(name, array=True) == Spelling(canonical(name), ARRAY)
    assert zero_based(name) == (f"{name}[0]", f"{name}[1]")
