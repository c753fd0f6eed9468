"""Begin a controller: from a starter kit, or from the matrices or weights of a design."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from controller_fmu import controller_from_mlp, controller_from_state_space, starters
from controller_fmu.errors import ControllerFmuError, NoCompilerError, UnstableError
from controller_fmu.export.state_space import INTERPOLATIONS
from controller_fmu.export.systems import METHODS

from ..errors import EnvironmentFault, InputError
from . import output
from .guard import EXIT_OK
from .values import Parser, number

STATE_SPACE, MLP = "statespace", "mlp"

EXAMPLES = """examples:
  flexible-manipulator new python my_controller             a folder with a controller in Python
  flexible-manipulator build my_controller                  its FMU
  flexible-manipulator evaluate my_controller/MyController.fmu
  flexible-manipulator new statespace gains.mat --out my.fmu
                                                            the FMU of a linear controller: A, B, C, D, T_s
  flexible-manipulator new numpy my_policy                  a folder with a neural network in NumPy (or onnx)
  flexible-manipulator new mlp policy.npz --out my.fmu      the FMU of its weights, in C: W1, b1, W2, b2, ...

exit codes: 0 written, 1 no compiler, or a full disk, 2 bad input"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = _parser()
    given = parser.parse_args(arguments)
    if given.kind in (STATE_SPACE, MLP):
        beside = given.folder.parent / f"{given.folder.stem}.fmu"
        return _built(given.kind, given.folder, given.out or beside, given)
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


def _built(kind: str, file: Path, out: Path, given: argparse.Namespace) -> int:
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


def _parser() -> Parser:
    parser = Parser("new", "Begin a controller of your own: from a starter kit, or of matrices or weights.", EXAMPLES)
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
