"""Build the benchmark's FMUs: the manipulator, its default controller in Python and in C, and better controllers.

    python build_fmus.py                                  all of them, into build/fmus
    python build_fmus.py DiagonalPID --output-dir /tmp    one of them, elsewhere
    python build_fmus.py --all                            also the controller for the other kinds of FMI

The sources are found beside this module, in a checkout as well as in an installed package.
"""

from __future__ import annotations

import argparse
import difflib
import sys
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

from controller_fmu.export import BuildError, Dialect, NoCompilerError, c_fmu, find_compiler, python_fmu

__all__ = ["NAMES", "VARIANTS", "BuildError", "Dialect", "NoCompilerError", "build", "c_fmu", "find_compiler"]
__all__ += ["main", "python_fmu"]

HERE = Path(__file__).resolve().parent
DEFAULT_OUTPUT_DIR = Path("build", "fmus")
EXIT_OK, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


def _flexible_manipulator(target: Path) -> Path:
    folder = HERE / "plant_fmu"
    packages = [folder / "flexible_manipulator"]
    return python_fmu(folder / "manipulator_fmu.py", packages, "flexible_manipulator.interface", target)


def _diagonal_pid(target: Path) -> Path:
    script = HERE / "controller_fmu" / "pid" / "diagonal_pid_fmu.py"
    return python_fmu(script, [], script.stem, target)


def _tuned_pid(target: Path) -> Path:
    folder = HERE / "controller_fmu" / "pid_tuned"
    script = folder / "tuned_pid_fmu.py"
    law = HERE / "controller_fmu" / "pid" / "diagonal_pid_fmu.py"
    return python_fmu(script, [law, folder / "tuned_pid_gains.json"], script.stem, target)


def _manipulator_lqg(target: Path) -> Path:
    folder = HERE / "controller_fmu" / "lqg"
    script = folder / "manipulator_lqg_fmu.py"
    needs = [folder / "flexible_manipulator_lqg.py", folder / "lqg_weights.json"]
    return python_fmu(script, needs, script.stem, target)


def _dithered_lqg(target: Path) -> Path:
    lqg, folder = HERE / "controller_fmu" / "lqg", HERE / "controller_fmu" / "friction"
    script = folder / "manipulator_friction_fmu.py"
    modules = [lqg / "flexible_manipulator_lqg.py", lqg / "manipulator_lqg_fmu.py"]
    needs = [*modules, folder / "flexible_manipulator_dither.py", folder / "friction_weights.json"]
    return python_fmu(script, needs, script.stem, target)


def _diagonal_pid_c(target: Path, dialect: Dialect) -> Path:
    folder = HERE / "controller_fmu" / "pid_c"
    return c_fmu(sorted(folder.glob("*.[ch]")), folder / "modelDescription.xml", target, dialect)


_RECIPES: dict[str, Callable[[Path], Path]] = {
    "FlexibleManipulator": _flexible_manipulator,
    "DiagonalPID": _diagonal_pid,
    "DiagonalPID_C": partial(_diagonal_pid_c, dialect=Dialect()),
    "TunedPID": _tuned_pid,
    "ManipulatorLQG": _manipulator_lqg,
    "DitheredLQG": _dithered_lqg,
}
_VARIANTS: dict[str, Callable[[Path], Path]] = {
    "DiagonalPID_C_fmi1": partial(_diagonal_pid_c, dialect=Dialect(1)),
    "DiagonalPID_C_fmi3": partial(_diagonal_pid_c, dialect=Dialect(3, arrays=True)),
    "DiagonalPID_C_fmi3_scalars": partial(_diagonal_pid_c, dialect=Dialect(3)),
    "DiagonalPID_C_me2": partial(_diagonal_pid_c, dialect=Dialect(2, "ModelExchange")),
    "DiagonalPID_C_me3": partial(_diagonal_pid_c, dialect=Dialect(3, "ModelExchange", arrays=True)),
}

NAMES = tuple(_RECIPES)
"""The FMUs of the benchmark, in the order they are built."""

VARIANTS = tuple(_VARIANTS)
"""The default controller for other kinds of FMI; they are built on demand."""


def build(name: str, output_dir: Path = DEFAULT_OUTPUT_DIR) -> Path:
    """Build the FMU ``name``, one of NAMES or VARIANTS, and return its path, ``output_dir/name.fmu``.

    Processes that build the same FMU at once do not disturb each other: the file is replaced in one go, and
    equal sources give equal bytes.

    Raises:
        ValueError: no FMU has this name.
        NoCompilerError: the FMU is written in C and this machine has no compiler.
        BuildError: anything else that went wrong.
    """
    recipes = {**_RECIPES, **_VARIANTS}
    if name not in recipes:
        near = difflib.get_close_matches(name, recipes, cutoff=0.4) or NAMES
        raise ValueError(f"no FMU is named {name!r}; did you mean {' or '.join(near)}?")
    return recipes[name](Path(output_dir) / f"{name}.fmu")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 built, 1 a build failed, 2 bad input."""
    options = _parser().parse_args(arguments)
    everything = NAMES + VARIANTS if options.all else NAMES
    unknown = [name for name in options.names if name not in NAMES + VARIANTS]
    try:
        options.output_dir.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        told = f"{options.output_dir} cannot be made a folder: {problem.strerror}. Choose another --output-dir."
        print(f"error: {told}", file=sys.stderr)
        return EXIT_BAD_INPUT
    code = EXIT_OK
    for name in unknown or options.names or everything:
        try:
            print(build(name, options.output_dir), flush=True)
        except ValueError as error:
            print(f"error: {error}", file=sys.stderr)
            code = EXIT_BAD_INPUT
        except NoCompilerError as error:
            print(f"skipped {error}", file=sys.stderr)
            code = max(code, EXIT_FAILED if name in options.names else EXIT_OK)
        except (BuildError, OSError) as error:
            print(f"error: {error}", file=sys.stderr)
            code = max(code, EXIT_FAILED)
    return code


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="build_fmus.py",
        description="Build the FMUs of the benchmark.",
        epilog="""names:
  FlexibleManipulator          the manipulator, Python (FMI 2.0 co-simulation)
  DiagonalPID                  the default controller, Python (FMI 2.0 co-simulation)
  DiagonalPID_C                the same in C (FMI 2.0 co-simulation)
  TunedPID                     the same in Python with optimised gains
  ManipulatorLQG               LQG, scheduled by the reference position, Python
  DitheredLQG                  the same with a dither against friction, Python
built with --all or by name, the controller in C for
  DiagonalPID_C_fmi1           FMI 1.0 co-simulation
  DiagonalPID_C_fmi3           FMI 3.0 co-simulation, variables are arrays
  DiagonalPID_C_fmi3_scalars   FMI 3.0 co-simulation, variables are scalars
  DiagonalPID_C_me2            FMI 2.0 Model Exchange, sampled by time events
  DiagonalPID_C_me3            FMI 3.0 Model Exchange, sampled by time events, variables are arrays
What is written in C is skipped where there is no C compiler (cc, gcc, clang, or the environment's CC).

examples:
  python build_fmus.py                            build the first six into build/fmus
  python build_fmus.py DiagonalPID                build one
  python build_fmus.py --output-dir /tmp/fmus     build elsewhere

exit codes: 0 built, 1 a build failed, 2 bad input""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="FMUs to build (default: the first six below)")
    parser.add_argument("--all", action="store_true", help="build the controller for the other kinds of FMI, too")
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=DEFAULT_OUTPUT_DIR,
        metavar="FOLDER",
        help="where to write them (default: %(default)s)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
