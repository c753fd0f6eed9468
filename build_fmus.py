"""Build the benchmark's FMUs: the manipulator and its default controller in Python and in C, and better controllers.

    python build_fmus.py                                  all of them, into build/fmus
    python build_fmus.py DiagonalPID --output-dir /tmp    one of them, elsewhere
    python build_fmus.py --all                            also for the other kinds of FMI
    python build_fmus.py --platforms all                  with binaries for all platforms, and reference trajectories
    python build_fmus.py --web                            the closed loop as a module of WebAssembly

The sources are found beside this module, in a checkout as well as in an installed package.
"""

from __future__ import annotations

import argparse
import difflib
import json
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from xml.etree.ElementTree import Element

from controller_fmu.errors import BuildError, NoCompilerError, PlatformError, TargetError
from controller_fmu.export import PLATFORMS, Dialect, c_fmu, find_compiler, python_fmu, unpack
from controller_fmu.export.archive import write_atomically
from controller_fmu.export.description import parse, to_bytes
from controller_fmu.export.one_program import PARTS, controller_files, interface_of, web_module
from controller_fmu.export.rows import description
from controller_fmu.export.trajectories import reference
from controller_fmu.export.twin import twin_description, twin_header
from controller_fmu.friction.flexible_manipulator_dither import Dither
from controller_fmu.imperfections.interface import description as imperfections_description
from controller_fmu.lqg.flexible_manipulator_lqg.interface import (
    BASE_UNITS,
    CONNECTORS,
    SAMPLE_TIME,
    Weights,
    parameters,
)
from controller_fmu.robust_c.interface import ROWS
from controller_fmu.steady_c.interface import ROWS as STEADY_ROWS
from plant_fmu.native import interface

__all__ = ["KNOWN", "NAMES", "NAMES_HELP", "PLANT_VARIANTS", "PLATFORMS", "VARIANTS", "BuildError", "Dialect"]
__all__ += ["NoCompilerError", "UnknownFmuError", "build", "build_all", "build_web", "c_fmu", "find_compiler", "main"]
__all__ += ["near", "platform_names", "python_fmu", "to_build"]

HERE = Path(__file__).resolve().parent
DEFAULT_OUTPUT_DIR = Path("build", "fmus")
EXIT_OK, EXIT_FAILED, EXIT_BAD_INPUT = 0, 1, 2


_DESIGN = ("checks.h", "design.c", "design.h", "law.h", "matrix.h")
"""Files of lqg_c that other controllers share."""

Platforms = Sequence[str]
Recipe = Callable[[Path, Platforms], Path]
"""Builds a file; what is written in Python has the binaries that pythonfmu brings along, whatever is asked for."""


class UnknownFmuError(BuildError):
    """The benchmark has no FMU of this name."""


def _flexible_manipulator(target: Path, _platforms: Platforms) -> Path:
    folder = HERE / "plant_fmu"
    packages = [folder / "flexible_manipulator"]
    return python_fmu(folder / "manipulator_fmu.py", packages, "flexible_manipulator.interface", target)


def _flexible_manipulator_native(target: Path, platforms: Platforms, dialect: Dialect) -> Path:
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        header, description = Path(folder, "interface.h"), Path(folder, "modelDescription.xml")
        header.write_text(interface.header(), encoding="utf-8")
        description.write_bytes(to_bytes(interface.description(dialect.interface == "ModelExchange")))
        sources = sorted((HERE / "plant_fmu" / "native").glob("*.[ch]"))
        return c_fmu([*sources, header], description, target, dialect, platforms)


def _diagonal_pid(target: Path, _platforms: Platforms) -> Path:
    script = HERE / "controller_fmu" / "pid" / "diagonal_pid_fmu.py"
    return python_fmu(script, [], script.stem, target)


def _tuned_pid(target: Path, _platforms: Platforms) -> Path:
    folder = HERE / "controller_fmu" / "pid_tuned"
    script = folder / "tuned_pid_fmu.py"
    law = HERE / "controller_fmu" / "pid" / "diagonal_pid_fmu.py"
    return python_fmu(script, [law, folder / "tuned_pid_gains.json"], script.stem, target)


def _manipulator_lqg(target: Path, _platforms: Platforms) -> Path:
    folder = HERE / "controller_fmu" / "lqg"
    script = folder / "manipulator_lqg_fmu.py"
    needs = [folder / "flexible_manipulator_lqg", folder / "lqg_weights.json"]
    return python_fmu(script, needs, script.stem, target)


def _dithered_lqg(target: Path, _platforms: Platforms) -> Path:
    lqg, folder = HERE / "controller_fmu" / "lqg", HERE / "controller_fmu" / "friction"
    script = folder / "manipulator_friction_fmu.py"
    modules = [lqg / "flexible_manipulator_lqg", lqg / "manipulator_lqg_fmu.py"]
    needs = [*modules, folder / "flexible_manipulator_dither.py", folder / "friction_weights.json"]
    return python_fmu(script, needs, script.stem, target)


def _dithered_lqg_c(target: Path, platforms: Platforms) -> Path:
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        twin = parse(unpack(_dithered_lqg(Path(folder, "DitheredLQG.fmu"), ()))["modelDescription.xml"])
    sources = sorted((HERE / "controller_fmu" / "lqg_c").glob("*.[ch]"))
    return _described_in_c(twin_description(twin), sources, target, platforms)


def _robust_lqg(target: Path, platforms: Platforms) -> Path:
    folder, shared = HERE / "controller_fmu" / "robust_c", HERE / "controller_fmu" / "lqg_c"
    what = "Three LQG controllers: a stiff one at rest, a damping one with a dither after an event, one for first peaks"
    sources = [*(shared / name for name in _DESIGN), *sorted(folder.glob("*.[ch]"))]
    root = description(ROWS, _starts(folder / "robust_weights.json"), what, BASE_UNITS)
    return _described_in_c(root, sources, target, platforms)


def _steady_lqg(target: Path, platforms: Platforms) -> Path:
    own, shared, designs = (HERE / "controller_fmu" / name for name in ("steady_c", "robust_c", "lqg_c"))
    what = "Three LQG controllers: a stiff one, a damping one with a dither, a strong one; no part is limited in time"
    sources = [
        *(designs / name for name in _DESIGN),
        *(shared / name for name in ("events.h", "feedback.h", "model.c", "overload.h")),
    ]
    root = description(STEADY_ROWS, _starts(own / "steady_weights.json"), what, BASE_UNITS)
    return _described_in_c(root, [*sources, own / "switching.h"], target, platforms)


def _robust_linear_lqg(target: Path, platforms: Platforms) -> Path:
    folder = HERE / "controller_fmu"
    what = "LQG controller, designed at initialization for the reference position, with weights for all uncertain arms"
    starts = _starts(folder / "robust_linear" / "linear_weights.json")
    root = description((*CONNECTORS, *parameters(Weights), *parameters(Dither)), starts, what, BASE_UNITS)
    return _described_in_c(root, sorted((folder / "lqg_c").glob("*.[ch]")), target, platforms)


def _starts(file: Path) -> dict[str, float]:
    return {"T_s": SAMPLE_TIME, **json.loads(file.read_text(encoding="utf-8"))["parameters"]}


def _described_in_c(root: Element, sources: Sequence[Path], target: Path, platforms: Platforms) -> Path:
    """The FMU of a model whose header follows from its description ``root``."""
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        header, described = Path(folder, "interface.h"), Path(folder, "modelDescription.xml")
        header.write_text(twin_header(root), encoding="utf-8")
        described.write_bytes(to_bytes(root))
        return c_fmu([*sources, header], described, target, Dialect(), platforms)


def _diagonal_pid_c(target: Path, platforms: Platforms, dialect: Dialect) -> Path:
    folder = HERE / "controller_fmu" / "pid_c"
    return c_fmu(sorted(folder.glob("*.[ch]")), folder / "modelDescription.xml", target, dialect, platforms)


def _imperfections(target: Path, platforms: Platforms) -> Path:
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
        description = Path(folder, "modelDescription.xml")
        description.write_bytes(to_bytes(imperfections_description()))
        sources = sorted((HERE / "controller_fmu" / "imperfections").glob("*.[ch]"))
        return c_fmu(sources, description, target, Dialect(), platforms)


_RECIPES: dict[str, Recipe] = {
    "FlexibleManipulator": _flexible_manipulator,
    "FlexibleManipulatorNative": partial(_flexible_manipulator_native, dialect=Dialect()),
    "DiagonalPID": _diagonal_pid,
    "DiagonalPID_C": partial(_diagonal_pid_c, dialect=Dialect()),
    "TunedPID": _tuned_pid,
    "ManipulatorLQG": _manipulator_lqg,
    "DitheredLQG": _dithered_lqg,
    "DitheredLQG_C": _dithered_lqg_c,
    "Imperfections": _imperfections,
    "RobustLQG": _robust_lqg,
    "RobustLinearLQG": _robust_linear_lqg,
    "SteadyLQG": _steady_lqg,
}
_PLANT_VARIANTS: dict[str, Recipe] = {
    "FlexibleManipulatorNative_fmi3": partial(_flexible_manipulator_native, dialect=Dialect(3)),
    "FlexibleManipulatorNative_me2": partial(_flexible_manipulator_native, dialect=Dialect(2, "ModelExchange")),
    "FlexibleManipulatorNative_me3": partial(_flexible_manipulator_native, dialect=Dialect(3, "ModelExchange")),
}
_VARIANTS: dict[str, Recipe] = {
    "DiagonalPID_C_fmi1": partial(_diagonal_pid_c, dialect=Dialect(1)),
    "DiagonalPID_C_fmi3": partial(_diagonal_pid_c, dialect=Dialect(3, arrays=True)),
    "DiagonalPID_C_fmi3_scalars": partial(_diagonal_pid_c, dialect=Dialect(3)),
    "DiagonalPID_C_me2": partial(_diagonal_pid_c, dialect=Dialect(2, "ModelExchange")),
    "DiagonalPID_C_me3": partial(_diagonal_pid_c, dialect=Dialect(3, "ModelExchange", arrays=True)),
}

_IN_PYTHON = ("FlexibleManipulator", "DiagonalPID", "TunedPID", "ManipulatorLQG", "DitheredLQG")
_MODELS = {name: name.partition("_fmi")[0].partition("_me")[0] for name in (*_RECIPES, *_PLANT_VARIANTS, *_VARIANTS)}
"""By name of an FMU that of the same model in FMI 2.0 co-simulation."""

NAMES = tuple(_RECIPES)
"""The FMUs of the benchmark, in the order they are built."""

PLANT_VARIANTS, VARIANTS = tuple(_PLANT_VARIANTS), tuple(_VARIANTS)
"""The native manipulator and the default controller for other kinds of FMI; they are built on demand."""

KNOWN = NAMES + PLANT_VARIANTS + VARIANTS
"""All of them."""

NAMES_HELP = f"""names:
  FlexibleManipulator          the manipulator, Python (FMI 2.0 co-simulation)
  FlexibleManipulatorNative    the same in C, equal to the last bit and faster (FMI 2.0 co-simulation)
  DiagonalPID                  the default controller, Python (FMI 2.0 co-simulation)
  DiagonalPID_C                the same in C (FMI 2.0 co-simulation)
  TunedPID                     DiagonalPID with optimised gains
  ManipulatorLQG               LQG, scheduled by the reference position, Python
  DitheredLQG                  the same with a dither against friction, Python
  DitheredLQG_C                the same in C, equal up to rounding (FMI 2.0 co-simulation)
  Imperfections                what the benchmark's loop has between controller and plant, C (FMI 2.0 co-simulation)
  RobustLQG                    three LQGs, switched by events, with a dither, in C (FMI 2.0 co-simulation)
  RobustLinearLQG              DitheredLQG_C without a dither, and weights that hold in truth
  SteadyLQG                    RobustLQG with no part that is limited in time
built with --all or by name, the manipulator in C for
  FlexibleManipulatorNative_fmi3   FMI 3.0 co-simulation
  FlexibleManipulatorNative_me2    FMI 2.0 Model Exchange, eight continuous states
  FlexibleManipulatorNative_me3    FMI 3.0 Model Exchange, eight continuous states
and the controller in C for
  DiagonalPID_C_fmi1           FMI 1.0 co-simulation
  DiagonalPID_C_fmi3           FMI 3.0 co-simulation, variables are arrays
  DiagonalPID_C_fmi3_scalars   FMI 3.0 co-simulation, variables are scalars
  DiagonalPID_C_me2            FMI 2.0 Model Exchange, sampled by time events
  DiagonalPID_C_me3            FMI 3.0 Model Exchange, sampled by time events, variables are arrays
What is written in C is skipped where there is no C compiler (cc, gcc, clang, the environment's CC, or the package
ziglang, which also compiles for the other platforms of --platforms:
{", ".join(PLATFORMS)}).
With --platforms, NAME_in.csv and NAME_ref.csv are written beside them: inputs, and what the FMU answers to them."""
"""The names, as the commands' help lists them."""


def build(name: str, output_dir: Path = DEFAULT_OUTPUT_DIR, platforms: Platforms = ()) -> Path:
    """Build the FMU ``name``, one of NAMES or the variants, and return its path, ``output_dir/name.fmu``.

    Processes that build the same FMU at once do not disturb each other: the file is replaced in one go, and
    equal sources give equal bytes. ``output_dir`` must exist, unless it is the default. An FMU in C gets binaries for
    ``platforms``, names in PLATFORMS, by the compiler in the package ``ziglang``; if empty, one for this machine by its
    own compiler.

    Raises:
        UnknownFmuError: no FMU has this name.
        TargetError: there is no folder ``output_dir``.
        PlatformError: there is no such platform.
        NoCompilerError: the FMU is written in C and this machine has no compiler.
        BuildError: anything else that went wrong.
    """
    recipes = {**_RECIPES, **_PLANT_VARIANTS, **_VARIANTS}
    if name not in recipes:
        raise UnknownFmuError(f"no FMU is named {name!r}", value=name, nearest=near(name))
    if Path(output_dir) == DEFAULT_OUTPUT_DIR:
        DEFAULT_OUTPUT_DIR.mkdir(parents=True, exist_ok=True)
    return recipes[name](Path(output_dir) / f"{name}.fmu", platforms)


WEB_FILES = ("closed_loop.wasm", "closed_loop.json", "controllers.json")


def build_web(output_dir: Path = DEFAULT_OUTPUT_DIR) -> tuple[Path, Path, Path]:
    """Compile the closed loop and its judging for WebAssembly; returns the module, a JSON file of what its numbers
    mean, and one with description and sources of the controllers' FMUs, by unit and path.

    Raises as :func:`build`, also :class:`NoCompilerError` without the package ``ziglang``.
    """
    from controller_fmu.export.state_space import controller_from_state_space  # loads NumPy

    if Path(output_dir) == DEFAULT_OUTPUT_DIR:
        DEFAULT_OUTPUT_DIR.mkdir(parents=True, exist_ok=True)
    module, meaning, controllers = (Path(output_dir, name) for name in WEB_FILES)
    with tempfile.TemporaryDirectory(prefix="build_fmus_") as name:
        folder = Path(name)
        files = {part: build(part, folder) for part in PARTS}
        zero = [[0.0, 0.0], [0.0, 0.0]]  # its matrices are given with a case
        linear = controller_from_state_space(zero, zero, zero, zero, SAMPLE_TIME, out=folder / "Linear.fmu")
        units = web_module(files, linear, module)
        sources = controller_files(files, linear)
    for value, file in ((interface_of(units), meaning), (sources, controllers)):
        write_atomically((json.dumps(value, indent=1) + "\n").encode(), file)
    return module, meaning, controllers


def references(name: str, output_dir: Path = DEFAULT_OUTPUT_DIR, platforms: Platforms = ()) -> tuple[Path, ...]:
    """The files of the reference trajectory that comes with the FMU ``name``: inputs and outputs of its model.

    There are some for an FMU in C that is built for ``platforms``, and none for others.
    """
    model = _MODELS.get(name, name)
    if not platforms or model in _IN_PYTHON:
        return ()
    return Path(output_dir, f"{model}_in.csv"), Path(output_dir, f"{model}_ref.csv")


def build_references(name: str, output_dir: Path = DEFAULT_OUTPUT_DIR, platforms: Platforms = ()) -> tuple[Path, ...]:
    """Write the files of :func:`references` and return them.

    They are computed on this machine, whatever the platforms: all have the same bits. Raises as :func:`build`.
    """
    files = references(name, output_dir, platforms)
    if files:
        with tempfile.TemporaryDirectory(prefix="build_fmus_") as folder:
            texts = reference(build(_MODELS[name], Path(folder)))
        for file, text in zip(files, texts, strict=True):
            write_atomically(text.encode(), file)
    return files


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code: 0 built, 1 a build failed, 2 bad input."""
    options = _parser().parse_args(arguments)
    if options.web:
        return _tried(partial(_show_web, options.output_dir), True)
    return build_all(options.names, options.output_dir, platform_names(options.platforms), options.all)


def _show_web(output_dir: Path) -> None:
    for file in build_web(output_dir):
        show(file)


def near(name: str) -> tuple[str, ...]:
    """The names that may have been meant by ``name``, the likeliest first."""
    return tuple(difflib.get_close_matches(name, KNOWN, cutoff=0.4)) or NAMES


def platform_names(text: str) -> tuple[str, ...]:
    """Names of platforms from a command line: separated by commas, or ``all``."""
    return tuple(PLATFORMS) if text == "all" else tuple(filter(None, text.split(",")))


def chosen(names: Sequence[str], variants: bool = False) -> Sequence[str]:
    """``names``, or NAMES if there are none, or KNOWN with ``variants``."""
    return names or (KNOWN if variants else NAMES)


def to_build(names: Sequence[str], output_dir: Path, platforms: Platforms = (), variants: bool = False) -> list[Path]:
    """The files that :func:`build_all` writes."""
    files = [
        file
        for name in chosen(names, variants)
        for file in (output_dir / f"{name}.fmu", *references(name, output_dir, platforms))
    ]
    return list(dict.fromkeys(files))


def show(file: Path) -> None:
    """Print a file at once, also into a pipe."""
    print(file, flush=True)


def build_all(
    names: Sequence[str],
    output_dir: Path,
    platforms: Platforms = (),
    variants: bool = False,
    tell: Callable[[Path], None] = show,
) -> int:
    """Build what was :func:`chosen`, ``tell`` each file that is built, and return the exit code of :func:`main`.

    Reference trajectories are written beside what is built in C for ``platforms``, one for each model.
    """
    unknown = [name for name in names if name not in KNOWN]
    code = EXIT_OK
    told: set[Path] = set()

    def one(name: str) -> None:
        tell(build(name, output_dir, platforms))
        if not told.issuperset(references(name, output_dir, platforms)):
            for file in build_references(name, output_dir, platforms):
                told.add(file)
                tell(file)

    for name in unknown or chosen(names, variants):
        code = max(code, _tried(partial(one, name), name in names))
        if code == EXIT_BAD_INPUT and not unknown:
            break
    return code


def _tried(work: Callable[[], None], asked: bool) -> int:
    """Do ``work``, and return the exit code of it alone; what was not ``asked`` for is skipped without a compiler."""
    try:
        work()
    except NoCompilerError as error:
        print(f"skipped {error}", file=sys.stderr)
        return EXIT_FAILED if asked else EXIT_OK
    except (UnknownFmuError, TargetError, PlatformError) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_BAD_INPUT
    except (BuildError, OSError) as error:
        print(f"error: {error}", file=sys.stderr)
        return EXIT_FAILED
    return EXIT_OK


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="build_fmus.py",
        description="Build the FMUs of the benchmark.",
        epilog=f"""{NAMES_HELP}

examples:
  python build_fmus.py                            # build the first twelve into build/fmus
  python build_fmus.py DiagonalPID                # build one
  python build_fmus.py --output-dir /tmp/fmus     # build elsewhere
  python build_fmus.py FlexibleManipulatorNative --platforms all
                                                  one FMU for Linux, Windows and macOS, and its trajectory
  python build_fmus.py --web                      # build/fmus/closed_loop.wasm, and JSON files

exit codes: 0 built, 1 a build failed, 2 bad input""",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="FMUs to build (default: the first twelve below)")
    parser.add_argument("--all", action="store_true", help="build for the other kinds of FMI, too")
    parser.add_argument(
        "--platforms",
        default="",
        metavar="NAMES",
        help="platforms of the FMUs in C, separated by commas, or 'all' (default: this machine's)",
    )
    parser.add_argument(
        "--web",
        action="store_true",
        help="in their place the closed loop as one module of WebAssembly, with what its numbers mean and the "
        "controllers' sources as JSON; "
        "needs the package ziglang",
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        default=DEFAULT_OUTPUT_DIR,
        metavar="FOLDER",
        help="existing folder to write them to (default: %(default)s, created if needed)",
    )
    return parser


if __name__ == "__main__":
    raise SystemExit(main())
