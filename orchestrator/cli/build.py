"""Build FMUs: a controller's from its folder, or the benchmark's own by name."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import build_fmus
from controller_fmu.errors import DialectError, PlatformError, SourceError, TargetError
from controller_fmu.export import BuildError, build_folder
from controller_fmu.export.folder import file_name

from ..errors import InputError
from ..text import printable
from . import output
from .guard import EXIT_BAD_INPUT, EXIT_INCOMPLETE
from .values import Parser

BAD_INPUT = (DialectError, PlatformError, SourceError, TargetError)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    parser = _parser()
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
    return _built(Path(folders[0]), platforms, given)


def _built(folder: Path, platforms: Sequence[str], given: argparse.Namespace) -> int:
    target = (given.output_dir or folder) / file_name(folder)
    try:
        return output.put_files([target if given.dry_run else build_folder(folder, target, platforms=platforms)], given)
    except (BuildError, OSError) as error:
        print(f"error: {printable(str(error))}", file=sys.stderr)
        return EXIT_BAD_INPUT if isinstance(error, BAD_INPUT) else EXIT_INCOMPLETE


def _parser() -> Parser:
    parser = Parser(
        "build",
        "Build the FMU of a controller from its folder, or FMUs of the benchmark by name.",
        f"""{build_fmus.NAMES_HELP}

examples:
  flexible-manipulator build my_controller             writes my_controller/MyController.fmu
  flexible-manipulator build my_controller --platforms x86_64-linux,x86_64-windows
                                                       in C, with binaries for these two
  flexible-manipulator build                           builds the first {len(build_fmus.NAMES)} above into build/fmus
  flexible-manipulator build TunedPID --output-dir .   builds one, elsewhere

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
        help="platforms of what is written in C, separated by commas, or 'all' (default: this machine's)",
    )
    parser.add_argument(
        "--output-dir",
        type=Path,
        metavar="FOLDER",
        help="existing folder to write to (default: the controller's folder; for names "
        f"{build_fmus.DEFAULT_OUTPUT_DIR}, created if needed)",
    )
    return parser
