"""The published numbers, pinned: what every change leaves as it is, or changes with a line in the CHANGELOG.

``tests/golden`` holds the rows of ``cases.csv`` to the last bit, for the protocol ``quick`` and one configuration of
``paper``, and the hashes of what the whole leaderboard is computed from: the FMUs' bytes and the cases. The files were
written by ``python -m orchestrator.evaluate NAME.fmu --quick`` and ``--only 'c07.*'``.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import io
import json
from pathlib import Path

import pytest

import build_fmus
from orchestrator import Benchmark, Controller

GOLDEN = Path(__file__).parent / "golden"
INPUTS = json.loads((GOLDEN / "inputs.json").read_text(encoding="utf-8"))
CONTROLLERS = ("DiagonalPID", "TunedPID", "ManipulatorLQG", "DitheredLQG")
COSTS = {
    "DiagonalPID": (122.18622803044019, 161.94956208867694),
    "TunedPID": (97.1564385948146, 154.20114268682178),
    "ManipulatorLQG": (68.24850431642342, 107.47667180839346),
    "DitheredLQG": (75.34159659414776, 109.84614838866723),
}
"""V of ``quick``, and of configuration 7 of ``paper``."""


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("run", ["quick", "paper-c07"])
def test_cases_and_cost_are_what_they_were(name, run, fmu_folder, tmp_path, request):
    if (name, run) == ("DiagonalPID", "quick"):
        evaluation = request.getfixturevalue("quick")
    else:
        protocol, only = ("quick", ()) if run == "quick" else ("paper", "c07.*")
        controller = Controller(build_fmus.build(name, fmu_folder))
        evaluation = Benchmark(protocol).evaluate(controller, only=only, recordings=False)
    written = (evaluation.save(tmp_path) / "cases.csv").read_text(encoding="utf-8")
    assert written == (GOLDEN / f"{name}.{run}.csv").read_text(encoding="utf-8")
    assert evaluation.cost == COSTS[name][run != "quick"]
    rows = list(csv.DictReader(io.StringIO(written)))
    assert len(rows) == (24 if run == "quick" else 18)
    assert {row["status"] for row in rows} <= {"done", "unstable"}, "the file itself holds verdicts"


@pytest.mark.parametrize("name", INPUTS["fmus"])
def test_fmus_have_the_bytes_of_the_leaderboard(name: str, fmu_folder: Path) -> None:
    assert hashlib.sha256(build_fmus.build(name, fmu_folder).read_bytes()).hexdigest() == INPUTS["fmus"][name]


@pytest.mark.parametrize("name", ["paper", "quick"])
def test_cases_are_those_of_the_leaderboard(name: str) -> None:
    digest = hashlib.sha256()
    for case in Benchmark(name).cases:
        scenario = dataclasses.asdict(case.scenario)
        del scenario["stop_time"]  # what FMUs are told; no number depends on it
        digest.update(json.dumps([case.id, scenario], default=str).encode())
    assert digest.hexdigest() == INPUTS[name]
