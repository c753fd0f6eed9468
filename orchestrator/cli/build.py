"""Build FMUs: the benchmark's own by name, or a controller from its folder."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

import build_fmus
from controller_fmu.export import BuildError, build_folder

from .guard import EXIT_OK


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and Path(words[0]).is_dir():
        try:
            print(build_folder(Path(words[0])))
        except BuildError as error:
            print(f"error: {error}", file=sys.stderr)
            return build_fmus.EXIT_FAILED
        return EXIT_OK
    return build_fmus.main(words)
