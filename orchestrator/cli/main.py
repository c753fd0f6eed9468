"""The console command ``flexible-manipulator``, and ``python -m orchestrator``: one word, then a command's options."""

from __future__ import annotations

import difflib
import sys
from collections.abc import Sequence

from ..version import __version__
from .guard import EXIT_BAD_INPUT, EXIT_OK, run

COMMANDS = {
    "evaluate": "run a protocol, print the scorecard, write results and report",
    "simulate": "simulate one case: signals and plot",
    "robustness": "search for the worst case, stability margins and robustness radius",
    "reliability": "bound the probability of a failure by independent draws",
    "verify": "evaluate with draws that the controller cannot know; write a certificate",
    "tune": "search for parameters that make V small while A1 to A3 hold",
    "sweep": "evaluate a grid of parameter values",
    "linearize": "A, B, C, D of the plant at a pose",
    "check": "check connectors, units, timing and behaviour of a controller FMU",
    "compare": "compare finished results",
    "report": "write the report or the figures of finished results again",
    "runs": "list past runs with V and date",
    "completion": "print a script that completes commands and options in bash and zsh",
    "new": "begin a controller from a starter kit, matrices or weights",
    "selftest": "check whether this machine gives the published bits",
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
        near = difflib.get_close_matches(words[0], COMMANDS, 1)
        hint = f"Did you mean {near[0]}?" if near else f"Commands: {', '.join(COMMANDS)}"
        print(f"error: there is no command {words[0]}. {hint}", file=sys.stderr)
        return EXIT_BAD_INPUT
    return run(words[0], words[1:])
