"""The code of docs/plant.md runs as it stands there."""

from __future__ import annotations

import re
import shutil
from pathlib import Path

import numpy as np
import pytest

PAGE = Path(__file__).resolve().parents[1] / "docs" / "plant.md"


def test_code_of_the_page(native_plant_file: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "build" / "fmus").mkdir(parents=True)
    shutil.copy(native_plant_file, tmp_path / "build" / "fmus")
    monkeypatch.chdir(tmp_path)
    scope: dict[str, np.ndarray] = {}
    (block,) = re.findall(r"^```python\n(.*?)^```", PAGE.read_text(encoding="utf-8"), re.DOTALL | re.MULTILINE)
    exec(compile(block, "docs/plant.md", "exec"), scope)
    assert 1e-5 < np.ptp(scope["pushed"]["X[1]"]) < 1.0
