"""Build an FMU from a folder with a controller in C or in Python:

python -m controller_fmu.export my_controller                                     writes my_controller/MyController.fmu
python -m controller_fmu.export my_controller MyController.fmu --fmi 3 --arrays   in C: FMI 3.0, arrays of two elements
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from controller_fmu.errors import BuildError, DialectError, SourceError, TargetError
from controller_fmu.export import Dialect, build_folder

EXIT_OK, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 built, 1 the build failed, 2 bad input."""
    options = _parser().parse_args(arguments)
    try:
        dialect = Dialect(options.fmi, "ModelExchange" if options.model_exchange else "CoSimulation", options.arrays)
        print(build_folder(options.folder, options.fmu, dialect))
    except (BuildError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT if isinstance(error, (DialectError, SourceError, TargetError)) else EXIT_FAILED
    return EXIT_OK


EPILOG = """examples:
  python -m controller_fmu.export my_controller                 # the FMU of a copy of a starter kit
  python -m controller_fmu.export my_controller --fmi 3         # for FMI 3, in C

exit codes: 0 built, 1 the build failed, 2 bad input"""


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m controller_fmu.export",
        description="Build an FMU from a folder with a controller in C or in Python, such as a copy of a starter kit.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("folder", type=Path, help="folder with the sources: .c and modelDescription.xml, or *_fmu.py")
    parser.add_argument(
        "fmu", type=Path, nargs="?", help="FMU to write (default: in FOLDER, named after it); names a model in C"
    )
    parser.add_argument("--fmi", type=int, choices=(1, 2, 3), default=2, help="version of FMI, in C (default: 2)")
    parser.add_argument(
        "--model-exchange", action="store_true", help="in C, FMI 2 and 3: sampled by time events, not co-simulation"
    )
    parser.add_argument("--arrays", action="store_true", help="in C, FMI 3: q_m with two elements instead of scalars")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
