"""The README's leaderboard is what its figures say, and its controllers are those that are built."""

from __future__ import annotations

import importlib.util
import json
from pathlib import Path

import build_fmus

ROOT = Path(__file__).resolve().parents[1]


def _script():
    spec = importlib.util.spec_from_file_location("leaderboard", ROOT / "benchmarks" / "leaderboard.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def test_the_readme_shows_the_figures_that_are_kept():
    script = _script()
    readme = script.README.read_text(encoding="utf-8")
    assert script.BEGIN in readme and script.END in readme
    assert readme == script.with_table(readme, json.loads(script.FIGURES.read_text(encoding="utf-8")))


def test_its_controllers_are_built_and_have_a_page():
    script = _script()
    assert set(script.CONTROLLERS) <= set(build_fmus.NAMES)
    for folder in script.CONTROLLERS.values():
        assert (ROOT / folder).is_dir()


def test_those_that_fail_a_requirement_come_last():
    script = _script()
    row = {"criteria": dict.fromkeys(script.SHOWN, 1.0), "stability": {"A1": True, "A2": True, "A3": True}}
    good, better = (
        {**row, "controller": "TunedPID", "cost": 110.0},
        {**row, "controller": "ManipulatorLQG", "cost": 90.0},
    )
    unstable = {**row, "controller": "DiagonalPID", "cost": 50.0, "stability": {"A1": True, "A2": False, "A3": False}}
    names = [line.split("]")[0][3:] for line in script.table([good, unstable, better]).splitlines()[2:]]
    assert names == ["ManipulatorLQG", "TunedPID", "DiagonalPID"]
