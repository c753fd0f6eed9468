"""From the form to the mapping file, and to the controller that the file describes."""

import tempfile
from pathlib import Path
from xml.etree.ElementTree import Element, SubElement

import pytest
from exporters.description_edits import edited
from hypothesis import given
from hypothesis import strategies as st

from orchestrator import Controller, InputError
from orchestrator.bounded import read_toml
from orchestrator.codec import to_json
from orchestrator.service import binding
from orchestrator.service.interface import MOST_TEXT, interface_of
from orchestrator.service.records import ConnectorRecord, Interface, VariableRecord


def variable(name: str, causality: str = "input", kind: str = "Real", size: int = 1, **rest) -> VariableRecord:
    return VariableRecord(name, causality, kind, "rad", size, **rest)


CONNECTORS = (
    ConnectorRecord("q_m", "rad", "angles", False, ("input",)),
    ConnectorRecord("u_m", "N.m", "torques", True, ("output",)),
)
VARIABLES = (
    *map(variable, ("In1", "In2", 'od"d\\\n[', "free")),
    variable("both", size=2),
    *(variable(name, "output") for name in ("Out1", "Out2")),
    variable("K", "parameter"),
    variable("on", "parameter", "Boolean"),
    variable("mode", "parameter", "Enumeration"),
    variable("row", "parameter", size=3),
    variable("label", "parameter", "String"),
)
INTERFACE = Interface(CONNECTORS, VARIABLES)


def file_of(chosen: dict[str, str], given: dict[str, str] | None = None) -> dict:
    return loaded(binding.mapping_file(INTERFACE, chosen, given or {}))


def loaded(text: str) -> dict:
    with tempfile.TemporaryDirectory() as place:
        file = Path(place) / "binding.toml"
        file.write_text(text, encoding="utf-8")
        return read_toml(file)


def test_a_form_becomes_a_mapping_file_whatever_the_names_are():
    chosen = {"q_m[1]": "In1", "q_m[2]": 'od"d\\\n[', "u_m[1]": "Out1", "u_m[2]": "Out2"}
    given = {"K": "1e-3", "on": "TRUE", "mode": "Manual", "row": "1, 2;3", "label": "a b", "free": " "}
    assert file_of(chosen, given) == {
        "map": chosen,
        "parameters": {"K": 1e-3, "on": True, "mode": "Manual", "row": [1.0, 2.0, 3.0], "label": "a b"},
    }


def test_an_array_is_both_axes():
    assert file_of({"q_m[1]": "both"}) == {"map": {"q_m": "both"}}


@pytest.mark.parametrize(
    ("chosen", "code"),
    [
        ({"q_m[1]": "In1"}, "bad-mapping"),
        ({"q_m[2]": "In1"}, "bad-mapping"),
        ({"q_m[1]": "both", "q_m[2]": "In1"}, "bad-mapping"),
        ({"q_m[1]": "In1", "q_m[2]": "In1"}, "bad-mapping"),
        ({"q_m[1]": "../x", "q_m[2]": "In1"}, "no-variable"),
    ],
)
def test_what_is_no_binding_is_refused(chosen, code):
    with pytest.raises(InputError) as refused:
        binding.mapping_file(INTERFACE, chosen, {})
    assert refused.value.what == code


def test_a_value_for_no_variable_is_refused_and_an_empty_form_is_no_file():
    with pytest.raises(InputError, match="no variable x"):
        binding.mapping_file(INTERFACE, {}, {"x": "1"})
    assert binding.mapping_file(INTERFACE, {}, {"K": ""}) == ""


@pytest.mark.parametrize("value", ["\x7f" * 10**6, ["\x7f" * 10**6], [1.0] * 10**6])
def test_what_is_too_large_is_refused_before_it_is_written(value, monkeypatch):
    """All people of the service wait while a binding is written: 11 s for a name of 8 MB."""
    monkeypatch.setattr(binding, "_toml", lambda _: pytest.fail("it is written"))
    with pytest.raises(InputError) as refused:
        binding.written({"q_m[1]": "x"}, {"K": value})
    assert refused.value.what == "file-limit"


def test_what_is_nearly_a_number_is_a_text_at_once():
    """10,000 digits took 5 s, and as many as here would take hours."""
    text = "1" * 1_000_000 + "x"
    assert binding._scalar(variable("K", "parameter"), text) == text


@given(st.dictionaries(st.text(st.characters(codec="utf-8"), min_size=1), st.text(st.characters(codec="utf-8"))))
def test_any_text_is_read_as_it_was_written(names):
    text = binding.written(names, names)
    assert not text or loaded(text) == {"map": names, **({"parameters": names} if names else {})}


def test_the_interface_of_an_fmu_shows_what_is_bound_and_what_could_be(pid_file):
    interface = interface_of(Controller(pid_file))
    bound = {connector.name: connector.bound for connector in interface.connectors}
    assert bound["q_m"] == ("q_m[1]", "q_m[2]") and bound["e"] == ()
    assert {v.name for v in binding.candidates(interface, interface.connectors[1])} >= {"u_m[1]", "u_m[2]"}
    assert "K_p[1]" in {v.name for v in binding.values(interface)} and "q_m[1]" not in {
        v.name for v in binding.values(interface)
    }


def test_names_without_an_end_are_bound_to_nothing_on_a_page(pid_file, tmp_path):
    """Two of 5 MB, bound since their last parts are those of a connector, made a page of 100 MB."""

    def lengthened(root: Element) -> None:
        for variable in root.iter("ScalarVariable"):
            if variable.get("name") in ("q_m[1]", "q_m[2]"):
                variable.set("name", f"{'a' * 100_000}.{variable.get('name')}")

    interface = interface_of(Controller(edited(pid_file, tmp_path / "long.fmu", lengthened)))
    assert {connector.name: connector.bound for connector in interface.connectors}["q_m"] == ()
    assert len(to_json(interface)) < 100_000


def test_the_interface_has_the_values_of_what_it_offers_alone(pid_file, monkeypatch):
    """Each look at a run reads them: 30,000 of a binding took 0.6 s."""
    monkeypatch.setattr("orchestrator.service.interface.MOST", 11)
    given = {f"{name}[{axis}]": 2.0 for name in ("K_p", "K_i", "K_d") for axis in (1, 2)}
    interface = interface_of(Controller(pid_file, parameters=given))
    offered = {variable.name for variable in interface.variables}
    assert {} != interface.given == {name: given[name] for name in given if name in offered} != given


def test_names_without_an_end_make_no_page_without_one(pid_file, tmp_path):
    """266 kB of an archive were a page of 224 MB, during which the service answered nobody."""

    def widened(root: Element) -> None:
        variables = root.find("ModelVariables")
        for number in range(200):
            words = {"name": f"v{number}" + "x" * 5000, "valueReference": str(900_000 + number)}
            added = SubElement(variables, "ScalarVariable", words, causality="input", variability="continuous")
            SubElement(added, "Real", start="0")

    interface = interface_of(Controller(edited(pid_file, tmp_path / "wide.fmu", widened)))
    assert sum(len(variable.name) for variable in interface.variables) <= MOST_TEXT
    assert len(interface.variables) + interface.left_out > 200
