"""Texts as a user reads them, in ``tests/snapshots``: after a change of words, ``REFRESH=1`` writes them anew."""

import os
from pathlib import Path

FOLDER = Path(__file__).parents[1] / "snapshots"


def snapshot(name: str, text: str) -> str:
    """What the snapshot ``name`` holds; ``text`` itself with ``REFRESH``, which is written there."""
    file = FOLDER / name
    if os.environ.get("REFRESH"):
        FOLDER.mkdir(exist_ok=True)
        file.write_text(text, encoding="utf-8")
    return file.read_text(encoding="utf-8")
