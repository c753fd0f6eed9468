"""The console command ``flexible-manipulator``, and ``python -m orchestrator``: one word, then a command's options. The
command ``completion`` completes these words in a shell.
"""

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
    "serve": "serve pages on which FMUs are evaluated and compared, for oneself or a group",
    "submit": "submit a controller FMU to such a service",
    "playground": "simulate cases in a browser, on a page that needs no installation",
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


COMPLETION_EXAMPLES = """examples:
  eval "$(flexible-manipulator completion)"          # in ~/.bashrc; in ~/.zshrc,
                                                     # put these words before it:
                                                     # autoload -U bashcompinit; bashcompinit;

exit codes: 0 done, 2 bad input"""

COMPLETION = """# Options come from each command's own help, which is asked for once a session.
_flexible_manipulator() {{
    local word="${{COMP_WORDS[COMP_CWORD]}}" command="${{COMP_WORDS[1]}}" options
    if [ "$COMP_CWORD" -eq 1 ]; then
        COMPREPLY=($(compgen -W "{commands}" -- "$word"))
    elif [ "${{word#-}}" != "$word" ]; then
        local known="_flexible_manipulator_$command"
        eval "options=\\"\\$$known\\""
        if [ -z "$options" ]; then
            options="$(flexible-manipulator "$command" --help 2>/dev/null)"
            options="$(printf '%s' "$options" | grep -oE -- '--[a-z][A-Za-z0-9-]*' | sort -u)"
            eval "$known=\\$options"
        fi
        COMPREPLY=($(compgen -W "$options" -- "$word"))
    else
        COMPREPLY=($(compgen -f -- "$word"))
    fi
}}
complete -o filenames -F _flexible_manipulator flexible-manipulator"""


def completion(arguments: Sequence[str] | None = None) -> int:
    """Print a script that completes the command ``flexible-manipulator`` in bash and zsh."""
    from .values import Parser  # loads more than a word that is no command needs

    Parser("completion", "Print a script that completes commands and options.", COMPLETION_EXAMPLES).parse_args(
        arguments
    )
    print(COMPLETION.format(commands=" ".join(COMMANDS)))
    return EXIT_OK
