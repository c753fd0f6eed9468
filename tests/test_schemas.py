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


@pytest.mark.parametrize("name", TYPES)
def test_a_schema_is_that_of_its_type(name):
    file, text = FOLDER / f"{name}.schema.json", to_json(json_schema(TYPES[name])) + "\n"
    if os.environ.get("REFRESH") == "schemas":
        file.write_text(text, encoding="utf-8")
    assert file.read_text(encoding="utf-8") == text
    assert set(json.loads(text)["$defs"]["Head"]["required"]) >= {"benchmark", "protocol", "controller", "plant"}


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
