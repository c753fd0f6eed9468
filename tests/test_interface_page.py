"""The interface page says of every variable of the plant and of the default PID what their FMUs say."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from fmpy import read_model_description

PAGE = (Path(__file__).resolve().parents[1] / "docs" / "interface.md").read_text(encoding="utf-8")


def documented(heading: str) -> dict[str, tuple[str, str, str, tuple[float, ...]]]:
    """Causality, variability, unit and starts by variable, from the table below ``heading``."""
    rows = {}
    for line in PAGE.split(f"## {heading}\n")[1].split("\n## ")[0].splitlines():
        cells = [cell.strip() for cell in line.strip("|").split("|")]
        for number, name in enumerate(re.findall(r"`([^`]+)`", cells[0])):
            starts = tuple(float(word) for word in cells[4].split(", ") if word)
            rows[name] = (*cells[1:4], starts[min(number, len(starts) - 1) :][:1])
    return rows


@pytest.mark.parametrize(
    ("heading", "file"), [("The plant FMU's variables", "plant_file"), ("The default PID's variables", "pid_file")]
)
def test_the_page_lists_every_variable_as_it_is(heading, file, request):
    variables = read_model_description(str(request.getfixturevalue(file))).modelVariables
    described = {
        variable.name: (
            variable.causality,
            variable.variability,
            variable.unit,
            () if variable.start is None else (pytest.approx(float(variable.start), rel=1e-5),),
        )
        for variable in variables
    }
    assert documented(heading) == described
