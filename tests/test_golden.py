"""The published numbers, pinned: what every change leaves as it is, or changes with a line in the CHANGELOG.

``tests/golden`` holds the rows of ``cases.csv`` to the last bit, for the protocol ``quick`` and for one configuration of
``paper``, and the hashes of what the whole leaderboard is computed from: the FMUs' bytes and the cases. The files were
written by ``python -m orchestrator.evaluate NAME.fmu --quick`` and ``--only 'c07.*'``.
"""

from __future__ import annotations

import csv
import dataclasses
import hashlib
import json
from pathlib import Path

import pytest

import build_fmus
from orchestrator import evaluate
from orchestrator.benchmark import protocol as protocols
from orchestrator.commands import nominal_parameters
from orchestrator.cosim.archive import open_archive

GOLDEN = Path(__file__).parent / "golden"
INPUTS = json.loads((GOLDEN / "inputs.json").read_text(encoding="utf-8"))
CONTROLLERS = ("DiagonalPID", "TunedPID", "ManipulatorLQG", "DitheredLQG")
COSTS = {
    "DiagonalPID": (122.18622803044019, 128.10112832688023),
    "TunedPID": (97.1564385948146, 109.02110862416208),
    "ManipulatorLQG": (68.24850431642342, 99.20334868795035),
    "DitheredLQG": (75.34159659414776, 79.72741228571827),
}
"""V of ``quick``, and of configuration 7 of ``paper``."""


@pytest.mark.slow
@pytest.mark.parametrize("name", CONTROLLERS)
@pytest.mark.parametrize("run", ["quick", "paper-c07"])
def test_cases_and_cost_are_what_they_were(name: str, run: str, fmu_folder: Path, tmp_path: Path) -> None:
    choice = ["--quick"] if run == "quick" else ["--only", "c07.*"]
    controller = build_fmus.build(name, fmu_folder)
    evaluate.main([str(controller), *choice, "--no-report", "--output-dir", str(tmp_path)])
    assert (tmp_path / "cases.csv").read_text(encoding="utf-8") == (GOLDEN / f"{name}.{run}.csv").read_text("utf-8")
    results = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))
    assert results["cost"] == COSTS[name][run != "quick"]


@pytest.mark.parametrize("name", INPUTS["fmus"])
def test_fmus_have_the_bytes_of_the_leaderboard(name: str, fmu_folder: Path) -> None:
    assert hashlib.sha256(build_fmus.build(name, fmu_folder).read_bytes()).hexdigest() == INPUTS["fmus"][name]


@pytest.mark.parametrize("name", ["paper", "quick"])
def test_cases_are_those_of_the_leaderboard(name: str, plant_file: Path) -> None:
    nominal = nominal_parameters(open_archive(plant_file), {})
    digest = hashlib.sha256()
    for case in protocols.cases(protocols.load(name), nominal, 0):
        digest.update(json.dumps([case.id, dataclasses.asdict(case.scenario)], default=str).encode())
    assert digest.hexdigest() == INPUTS[name]


def test_golden_rows_hold_numbers() -> None:
    """The files themselves: 24 and 18 cases each, all with a verdict."""
    for name in CONTROLLERS:
        for run, count in (("quick", 24), ("paper-c07", 18)):
            rows = list(csv.DictReader((GOLDEN / f"{name}.{run}.csv").open(encoding="utf-8")))
            assert len(rows) == count and all(row["status"] in ("done", "unstable") for row in rows)
