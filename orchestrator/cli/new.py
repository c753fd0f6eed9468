"""Begin a controller of one's own from a starter kit."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path

from controller_fmu import starters
from controller_fmu.errors import ControllerFmuError

from ..errors import InputError
from .guard import EXIT_OK
from .values import Parser

EXAMPLES = """examples:
  flexible-manipulator new python my_controller     a folder with a controller in Python
  flexible-manipulator build my_controller          its FMU
  flexible-manipulator evaluate my_controller/MyController.fmu"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = Parser("new", "Begin a controller of your own from a starter kit.", EXAMPLES)
    parser.add_argument("kind", choices=starters.KINDS, help="the language")
    parser.add_argument("folder", type=Path, help="the folder to make; the controller is named after it")
    given = parser.parse_args(arguments)
    try:
        starters.copy(given.kind, given.folder)
    except ControllerFmuError as problem:
        raise InputError(str(problem), "bad-starter", given.folder) from None
    files = ", ".join(sorted(file.name for file in given.folder.iterdir()))
    print(f"written to {given.folder}: {files}", file=sys.stderr)
    print(f"flexible-manipulator build {given.folder}")
    return EXIT_OK
