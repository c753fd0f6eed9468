"""One form for all spellings of a controller's parameters and mapping."""

from pathlib import Path

from fmpy.model_description import ModelDescription
from hypothesis import given
from hypothesis import strategies as some
from support.descriptions import description, pair, usual, variable
from support.refusals import refusal

from orchestrator.fmi.archive import Archive
from orchestrator.fmi.lookup import find_values
from orchestrator.fmi.variables import variables
from orchestrator.loop.setup import Setup, controller_binding, effective

STARTS = {"K": (45.0,), "z": (0.0,), "A": (1.0, 2.0)}
"""Parameters and their start values: scalars, an array."""

NAMES = ("K", "z", "A[1]", "A[2]")
MAPPINGS = ({}, {"u_m[1]": "u_m[1]", "u_m[2]": "u_m[2]"}, {"q_m[2]": "q_m[2]", "q_m[1]": "q_m[1]"})


def archive(shown: ModelDescription) -> Archive:
    """An archive without a file."""
    return Archive(Path("x.fmu"), "", Path("."), shown, "CoSimulation")


def parameters():
    """Those of ``STARTS``, as a model description has them."""
    for name, start in STARTS.items():
        yield variable(name, "parameter", size=len(start), start=" ".join(map(str, start)))
    yield variable("T_s", "parameter", start="0.00025")


CONTROLLER = archive(usual(*parameters()))


def acting(setup: Setup):
    """What an FMU is told beyond its start values, and to which variables it is connected."""
    shown = CONTROLLER.description
    told = find_values(shown, setup.parameters, "x")
    values = {each.name: tuple(told.get(each, each.start)) for each in variables(shown).values()}
    bound = {name: each.variables for name, each in controller_binding(CONTROLLER, setup).items()}
    return values, bound


@given(
    some.dictionaries(some.sampled_from(NAMES), some.sampled_from((0.0, -0.0, 1.0, 2.0, 45.0, 45, 0.1))),
    some.sampled_from(MAPPINGS),
    some.booleans(),
)
def test_every_spelling_has_the_same_form(parameters, mapping, backwards):
    spelled = Setup(parameters, mapping)
    found = effective(CONTROLLER, spelled)
    assert acting(found) == acting(spelled)
    assert effective(CONTROLLER, found) == found
    assert list(found.parameters) == sorted(found.parameters) and found.mapping == {}
    unchanged = {"A[1]": 1.0, "A[2]": 2.0, "K": 45.0, "z": 0.0}
    words = list({**unchanged, **parameters}.items())
    words = words[::-1] if backwards else words
    assert repr(effective(CONTROLLER, Setup(dict(words)))) == repr(found)


def test_what_acts_is_kept():
    assert effective(CONTROLLER, Setup({"z": -0.0, "A[2]": 3})).parameters == {"A[1]": 1.0, "A[2]": 3.0, "z": -0.0}
    # It is taken from the benchmark, which would set another.
    assert effective(CONTROLLER, Setup({"T_s": 0.00025})).parameters == {"T_s": 0.00025}


def test_a_mapping_that_is_needed_names_every_connector_in_one_way():
    shown = description([*pair(["In1", "In2", "Out1", "Out2"]), *pair(["q_m_ref[1]", "q_m_ref[2]"])])
    for each in shown.modelVariables[2:4]:
        each.causality = "output"
    inputs, outputs = {"q_m[1]": "In1", "q_m[2]": "In2"}, {"u_m[1]": "Out1", "u_m[2]": "Out2"}
    redundant = {"q_m_ref[1]": "q_m_ref[1]", "q_m_ref[2]": "q_m_ref[2]"}
    spelled = [Setup({}, {**inputs, **outputs}), Setup({}, {**redundant, **outputs, **inputs})]
    forms = [repr(effective(archive(shown), each)) for each in spelled]
    assert forms == [repr(Setup({}, dict(sorted({**inputs, **outputs, **redundant}.items()))))] * 2


def test_what_does_not_fit_is_refused():
    assert refusal(effective, CONTROLLER, Setup({"K_p": 1.0})).what == "no-parameter"
    assert refusal(effective, CONTROLLER, Setup({}, {"q_m[1]": "q_m[1]"})).what == "bad-mapping"


def test_values_of_other_types_and_inputs_have_one_form_as_well():
    shown = usual(
        variable("on", "parameter", kind="Boolean", start="true"),
        variable("mode", "parameter", kind="Integer", start="2"),
        variable("name", "parameter", kind="String", start="a"),
        variable("idle", "input", start="1.5"),
    )
    unchanged = {"on": True, "mode": 2.0, "name": "a", "idle": 1.5}
    assert effective(archive(shown), Setup(unchanged)) == Setup()
    changed = {"on": False, "name": "b", "mode": 3, "idle": 0.0}
    assert effective(archive(shown), Setup({**unchanged, **changed})).parameters == changed
