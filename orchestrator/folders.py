"""Where extracted FMUs and compiled code are kept between runs."""

from __future__ import annotations

import os
from pathlib import Path

import platformdirs

VARIABLE = "FLEXIBLE_MANIPULATOR_CACHE"
"""Environment variable that moves the cache elsewhere."""


def cache_folder() -> Path:
    """The user's cache folder for this program; not created here."""
    return Path(os.environ.get(VARIABLE) or platformdirs.user_cache_dir("flexible-manipulator", appauthor=False))
