"""Build an FMU from a folder with a model in C:

python -m controller_fmu.export examples/c MyController.fmu                    FMI 2.0 co-simulation
python -m controller_fmu.export examples/c MyController.fmu --fmi 3 --arrays   FMI 3.0, arrays instead of scalars
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from controller_fmu.export import BuildError, Dialect, c_fmu

EXIT_OK, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 built, 1 the build failed, 2 bad input."""
    options = _parser().parse_args(arguments)
    description = options.folder / "modelDescription.xml"
    sources = sorted(options.folder.glob("*.[ch]"))
    if not (sources and description.is_file()):
        print(f"error: {options.folder} needs the model's .c files and a modelDescription.xml", file=sys.stderr)
        return EXIT_BAD_INPUT
    try:
        dialect = Dialect(options.fmi, "ModelExchange" if options.model_exchange else "CoSimulation", options.arrays)
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    try:
        print(c_fmu(sources, description, options.fmu, dialect))
    except (BuildError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m controller_fmu.export",
        description="Build an FMU from a model in C; controller_fmu/c_interface/model.h says what a model provides.",
        epilog="exit codes: 0 built, 1 the build failed, 2 bad input",
    )
    parser.add_argument("folder", type=Path, help="folder with the .c and .h files and the modelDescription.xml")
    parser.add_argument("fmu", type=Path, help="the FMU to write; the model is named after it")
    parser.add_argument("--fmi", type=int, choices=(1, 2, 3), default=2, help="version of FMI (default: 2)")
    parser.add_argument(
        "--model-exchange", action="store_true", help="sampled by time events, for FMI 2 and 3 (default: co-simulation)"
    )
    parser.add_argument("--arrays", action="store_true", help="FMI 3: q_m with two elements, not q_m[1] and q_m[2]")
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
