"""The tutorial's H-infinity design: its norm, its loop, and the scorecard that the documentation gives."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest

from orchestrator import Benchmark

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def example():
    """The example as a module."""
    spec = importlib.util.spec_from_file_location("h_infinity", ROOT / "examples" / "h_infinity.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.mark.needs("slycot")
def test_the_norm_is_below_the_bound(example):
    """From all disturbances to all that is held small, on a grid of frequencies: the definition of the norm."""
    model = Benchmark("quick").linearize((0.3, -0.9), "nominal", friction="sliding")
    A, B, C, D = example.generalized_plant(model)
    K = example.h_infinity(model)
    norms = []
    for z in np.exp(1j * np.geomspace(1e-4, np.pi, 400)):
        P = C @ np.linalg.solve(z * np.eye(len(A)) - A, B) + D
        own = K[2] @ np.linalg.solve(z * np.eye(len(K[0])) - K[0], K[1]) + K[3]
        through = P[:8, 8:] @ own @ np.linalg.solve(np.eye(2) - P[8:, 8:] @ own, P[8:, :8])
        norms.append(np.linalg.norm(P[:8, :8] + through, 2))
    assert 1.0 < max(norms) < example.GAMMA


@pytest.mark.slow
@pytest.mark.needs("slycot", "compiler")
def test_the_design_has_the_scorecard_of_the_documentation(example, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    evaluation = example.main("quick")
    page = (ROOT / "docs" / "design.md").read_text(encoding="utf-8")
    assert f"V = {evaluation.cost:.1f} on `quick`" in page
    assert all(requirement.passed for requirement in evaluation.requirements.values())
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) == 2 and all(line in page for line in printed)
