"""The schemas of all documents are those of their types. After a change: REFRESH=schemas python -m pytest FILE."""

import json
import os
from pathlib import Path

import pytest
from support.reports import hunted, results_of, seeded, tuned

from orchestrator.cli.finished import KINDS
from orchestrator.codec import json_schema, plain, to_json
from orchestrator.documents.evaluation import Evaluation
from orchestrator.documents.results import Results

FOLDER = Path(__file__).parents[1] / "docs" / "schemas"
TYPES = {Path(name).stem: Results if kind is Evaluation else kind for name, kind in KINDS.items()}
EXAMPLES = {"results": results_of(), "spread": seeded(1.0, range(2)), "robustness": hunted()[0], "tuning": tuned()}


def outline(schema):
    """What another version of msgspec writes alike: the fields of each type, and those that must be there."""
    return {
        name: [sorted(of.get(key, ())) for key in ("properties", "required")] for name, of in schema["$defs"].items()
    }


@pytest.mark.parametrize("name", TYPES)
def test_a_schema_is_that_of_its_type(name):
    file, expected = FOLDER / f"{name}.schema.json", json.loads(to_json(json_schema(TYPES[name])))
    if os.environ.get("REFRESH") == "schemas":
        file.write_text(to_json(expected) + "\n", encoding="utf-8")
    schema = json.loads(file.read_text(encoding="utf-8"))
    assert outline(schema) == outline(expected)
    if schema["$comment"] == expected["$comment"]:
        assert schema == expected
    assert set(schema["$defs"]["Head"]["required"]) >= {"benchmark", "protocol", "controller", "plant"}


@pytest.mark.needs("jsonschema")
@pytest.mark.parametrize("name", EXAMPLES)
def test_documents_conform_to_their_schema_and_others_do_not(name):
    import jsonschema

    schema = json.loads((FOLDER / f"{name}.schema.json").read_text(encoding="utf-8"))
    validator = jsonschema.Draft202012Validator(schema)
    contents = plain(EXAMPLES[name])
    assert not list(validator.iter_errors(json.loads(to_json(EXAMPLES[name]))))
    for wrong in ({"head": None}, {"more": 1}):
        assert list(validator.iter_errors({**contents, **wrong}))
