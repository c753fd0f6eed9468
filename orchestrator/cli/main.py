"""The console command ``flexible-manipulator``, and ``python -m orchestrator``: one word, then a command's options."""

from __future__ import annotations

import sys
from collections.abc import Sequence

from ..version import __version__
from .guard import EXIT_BAD_INPUT, EXIT_OK, run

COMMANDS = {
    "evaluate": "run a protocol, print the scorecard, write results and report",
    "simulate": "one case in full: signals, plot, figures",
    "robustness": "the worst case: search, margins, robustness radius",
    "reliability": "a bound of the probability of failure, by independent draws",
    "verify": "the result one can trust: draws nobody knew, a judge nobody reaches",
    "tune": "search for parameters of a controller that make V small",
    "sweep": "V and stability over a grid of parameter values",
    "linearize": "A, B, C, D of the plant at a pose",
    "check": "what a controller FMU is, how it is connected, how it behaves",
    "compare": "finished evaluations side by side",
    "report": "the report of a finished evaluation again, or figures of it",
    "runs": "past runs, with V and date",
    "completion": "a script that completes commands and options in bash and zsh",
    "new": "begin a controller from a starter kit",
    "selftest": "whether this machine gives the published bits",
    "build": "build a controller's FMU from its folder, or the benchmark's own",
}

USAGE = """usage: flexible-manipulator COMMAND [OPTION ...]

Robust control benchmark of a flexible manipulator, for any controller that speaks FMI.

commands:
{commands}

flexible-manipulator COMMAND --help explains a command; --version prints the version.
The page docs/manipulator.md of the documentation explains symbols, angles and terms."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if not words or words[0] in ("-h", "--help"):
        print(USAGE.format(commands="\n".join(f"  {name:12}{text}" for name, text in COMMANDS.items())))
        return EXIT_OK if words else EXIT_BAD_INPUT
    if words[0] == "--version":
        print(f"flexible-manipulator-benchmark {__version__}")
        return EXIT_OK
    if words[0] not in COMMANDS:
        print(f"error: there is no command {words[0]}. Commands: {', '.join(COMMANDS)}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return run(words[0], words[1:])
