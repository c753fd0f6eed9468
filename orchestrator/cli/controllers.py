"""The commands ``new`` and ``build``, by which a controller begins and becomes an FMU."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import build_fmus
from controller_fmu import controller_from_mlp, controller_from_state_space, starters
from controller_fmu.errors import (
    ControllerFmuError,
    DialectError,
    NoCompilerError,
    PlatformError,
    SourceError,
    TargetError,
    UnstableError,
)
from controller_fmu.export import BuildError, build_folder
from controller_fmu.export.folder import file_name
from controller_fmu.export.state_space import INTERPOLATIONS
from controller_fmu.export.systems import METHODS

from ..errors import EnvironmentFault, InputError
from ..text import printable
from . import output
from .guard import EXIT_BAD_INPUT, EXIT_INCOMPLETE, EXIT_OK
from .values import Parser, number

STATE_SPACE, MLP = "statespace", "mlp"

NEW_EXAMPLES = """examples:
  flexible-manipulator new python my_controller             # a folder with a controller in Python
  flexible-manipulator build my_controller                  # its FMU
  flexible-manipulator evaluate my_controller/MyController.fmu
  flexible-manipulator new statespace gains.mat --out my.fmu
                                                            # the FMU of a linear controller: A, B, C, D, T_s
  flexible-manipulator new numpy my_policy                  # a folder with a neural network in NumPy (or onnx)
  flexible-manipulator new mlp policy.npz --out my.fmu      # the FMU of its weights, in C: W1, b1, W2, b2, ...

exit codes: 0 written, 1 no compiler, or a full disk, 2 bad input"""


def new(arguments: Sequence[str] | None = None) -> int:
    """Begin a controller: from a starter kit, or from the matrices or weights of a design."""
    parser = _new_parser()
    given = parser.parse_args(arguments)
    if given.kind in (STATE_SPACE, MLP):
        beside = given.folder.parent / f"{given.folder.stem}.fmu"
        return _built_from(given.kind, given.folder, given.out or beside, given)
    if given.out is not None:
        parser.error(f"--out is for {STATE_SPACE} and {MLP}")
    try:
        texts, data = starters.contents(given.kind, given.folder)
        written = sorted(given.folder / name for name in (*texts, *(path.name for path in data)))
        if given.dry_run:
            return output.put_files(written, given)
        starters.copy(given.kind, given.folder)
    except ControllerFmuError as problem:
        raise InputError(str(problem), "bad-starter", given.folder) from None
    if given.json:
        return output.put_files(written, given)
    output.tell_written(given.folder, (file.name for file in written))
    print(f"flexible-manipulator build {given.folder}")
    return EXIT_OK


def _built_from(kind: str, file: Path, out: Path, given: argparse.Namespace) -> int:
    how = {name: getattr(given, name) for name in ("T_s", "method", "interpolation", "unstable")}
    if given.dry_run:
        return output.put_files([out], given)
    try:
        built = controller_from_mlp(file, out=out) if kind == MLP else controller_from_state_space(file, out=out, **how)
        return output.put_files([built], given)
    except NoCompilerError as problem:
        raise EnvironmentFault(str(problem), "cannot-build") from None
    except ControllerFmuError as problem:
        code = "unstable-system" if isinstance(problem, UnstableError) else "bad-system"
        raise InputError(f"{problem}.", code, problem.where or file, problem.value, problem.nearest) from None


def _new_parser() -> Parser:
    parser = Parser(
        "new", "Begin a controller of your own: from a starter kit, or of matrices or weights.", NEW_EXAMPLES
    )
    parser.add_argument(
        "kind",
        choices=(*starters.KINDS, STATE_SPACE, MLP),
        help=f"the language or the kind of policy, {STATE_SPACE} for a linear controller, {MLP} for a network in C",
    )
    parser.add_argument(
        "folder",
        type=Path,
        metavar="FOLDER|FILE",
        help="the folder to make, after which the controller is named; "
        f"for {STATE_SPACE} the .mat, .npz or .json file with A, B, C, D, T_s, "
        f"for {MLP} the .npz file with W1, b1, W2, b2, ..., activation",
    )
    help = f"for {STATE_SPACE} and {MLP}, the FMU to write (default: beside the file)"
    parser.add_argument("--out", type=Path, metavar="FMU", help=help)
    output.add_files(parser)
    group = parser.add_argument_group(STATE_SPACE)
    group.add_argument(
        "--sample-time",
        type=number(above=0.0),
        metavar="SECONDS",
        dest="T_s",
        help="the sample time, where the file has none, or that to sample a continuous controller with",
    )
    group.add_argument("--method", choices=METHODS, help="how to sample a continuous controller")
    group.add_argument(
        "--interpolation",
        choices=INTERPOLATIONS,
        default=INTERPOLATIONS[0],
        help="between the points of a schedule (default: the nearest one)",
    )
    group.add_argument(
        "--unstable", action="store_true", help="take a controller that is unstable by itself, which is else refused"
    )
    return parser


BAD_INPUT = (DialectError, PlatformError, SourceError, TargetError)


def build(arguments: Sequence[str] | None = None) -> int:
    """Build FMUs: a controller's from its folder, or the benchmark's own by name."""
    parser = _build_parser()
    given = parser.parse_args(arguments)
    folders = [word for word in given.what if Path(word).is_dir()]
    platforms = build_fmus.platform_names(given.platforms)
    if not folders:
        for word in given.what:
            if word not in build_fmus.KNOWN:
                near = build_fmus.near(word)
                hint = "Its FMUs are" if near == build_fmus.NAMES else "There are"
                what = f"{word} is neither a folder nor an FMU of the benchmark. {hint}: {', '.join(near)}."
                raise InputError(what, "no-fmu", word, word, near)
        output_dir = given.output_dir or build_fmus.DEFAULT_OUTPUT_DIR
        if given.dry_run:
            return output.put_files(build_fmus.to_build(given.what, output_dir, platforms, given.all), given)
        built: list[Path] = []
        code = build_fmus.build_all(
            given.what, output_dir, platforms, given.all, built.append if given.json else build_fmus.show
        )
        if given.json:
            output.put_files(built, given)
        return code
    if len(given.what) > 1:
        parser.error(f"{folders[0]} is a folder, which is built alone: leave out the other words")
    if given.all:
        parser.error(f"--all is for the benchmark's own FMUs, and {folders[0]} is a folder")
    return _built_folder(Path(folders[0]), platforms, given)


def _built_folder(folder: Path, platforms: Sequence[str], given: argparse.Namespace) -> int:
    target = (given.output_dir or folder) / file_name(folder)
    try:
        return output.put_files([target if given.dry_run else build_folder(folder, target, platforms=platforms)], given)
    except (BuildError, OSError) as error:
        print(f"error: {printable(str(error))}", file=sys.stderr)
        return EXIT_BAD_INPUT if isinstance(error, BAD_INPUT) else EXIT_INCOMPLETE


def _build_parser() -> Parser:
    parser = Parser(
        "build",
        "Build the FMU of a controller from its folder, or FMUs of the benchmark by name.",
        f"""{build_fmus.NAMES_HELP}

examples:
  flexible-manipulator build my_controller             # writes my_controller/MyController.fmu
  flexible-manipulator build my_controller --platforms x86_64-linux,x86_64-windows
                                                       # in C, with binaries for these two
  flexible-manipulator build                           # builds the first {len(build_fmus.NAMES)} above into build/fmus
  flexible-manipulator build TunedPID --output-dir .   # builds one, elsewhere

exit codes: 0 built, 1 a build failed, 2 bad input""",
    )
    parser.add_argument(
        "what",
        nargs="*",
        metavar="FOLDER|NAME",
        help="one folder with a controller's sources (.c files and a modelDescription.xml, or a *_fmu.py), or names "
        f"of FMUs of the benchmark (default: the first {len(build_fmus.NAMES)} below); a folder comes before an FMU of "
        "the same name",
    )
    output.add_files(parser)
    parser.add_argument("--all", action="store_true", help="without a folder: build for the other kinds of FMI, too")
    parser.add_argument(
        "--platforms",
        default="",
        metavar="NAMES",
        help="platforms of what is written in C, separated by commas, such as linux64,win64, or 'all' (default: this "
        "machine's)",
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        metavar="FOLDER",
        help="existing folder to write to (default: the controller's folder; for names "
        f"{build_fmus.DEFAULT_OUTPUT_DIR}, created if needed)",
    )
    return parser
