"""Build the page that simulates cases in a browser, and open it."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import webbrowser
from collections.abc import Sequence
from pathlib import Path

import build_fmus
from controller_fmu.errors import BuildError, NoCompilerError

from ..api.benchmark import Benchmark
from ..documents.files import write_text
from ..documents.playground import playground_data, playground_plots
from ..errors import EnvironmentFault
from ..views.page import playground_html
from .guard import EXIT_OK
from .values import Parser

PROTOCOLS = ("paper", "quick")
PAGE = Path("build", "playground.html")

EXAMPLES = """examples:
  flexible-manipulator playground                            # builds the page and opens it
  flexible-manipulator playground --output page.html --no-open
                                                             # only builds it, elsewhere

exit codes: 0 built, 1 the compiler failed or is missing, 2 bad input"""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    given = _parser().parse_args(arguments)
    if given.dry_run:
        print(given.output)
        return EXIT_OK
    if given.output == PAGE:
        PAGE.parent.mkdir(parents=True, exist_ok=True)
    write_text(given.output, built_page())
    print(given.output, flush=True)
    if not given.no_open and not webbrowser.open(given.output.resolve().as_uri()):
        print("no browser was found: open the file yourself", file=sys.stderr)
    return EXIT_OK


def built_page() -> str:
    """The page as HTML.

    Raises :class:`~orchestrator.errors.EnvironmentFault` if the compiler fails, or there is none.
    """
    with tempfile.TemporaryDirectory() as folder:
        try:
            module, meaning, controllers = build_fmus.build_web(Path(folder))
        except NoCompilerError as problem:
            raise EnvironmentFault(str(problem), "no-compiler") from problem
        except BuildError as problem:
            raise EnvironmentFault(str(problem), "no-build") from problem
        program = module.read_bytes()
        interface, files = (json.loads(file.read_text(encoding="utf-8")) for file in (meaning, controllers))
    benches = {name: Benchmark(name) for name in PROTOCOLS}
    main_rules = benches[PROTOCOLS[0]].rules
    data = playground_data(
        program, interface, files, {name: (bench.rules, bench.cases) for name, bench in benches.items()}
    )
    return playground_html(data, playground_plots(main_rules))


def _parser() -> argparse.ArgumentParser:
    parser = Parser(
        "playground",
        "Build the page on which cases are simulated in a browser, with the bits of this program, and open it.",
        EXAMPLES,
    )
    parser.add_argument(
        "--output", type=Path, default=PAGE, metavar="FILE", help="the page to write (default: %(default)s)"
    )
    parser.add_argument("--no-open", action="store_true", help="do not open it in a browser")
    parser.add_argument("--dry-run", action="store_true", help="print which file would be written, and do nothing")
    return parser
