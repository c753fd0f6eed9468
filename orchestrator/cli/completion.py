"""Print a script that completes the command ``flexible-manipulator`` in bash and zsh."""

from __future__ import annotations

from collections.abc import Sequence

from .guard import EXIT_OK
from .values import Parser

EXAMPLES = """examples:
  eval "$(flexible-manipulator completion)"          in ~/.bashrc; in ~/.zshrc,
                                                     put these words before it:
                                                     autoload -U bashcompinit; bashcompinit;

exit codes: 0 done, 2 bad input"""

SCRIPT = """# Options come from each command's own help, which is asked for once a session.
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


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return its exit code."""
    from .main import COMMANDS  # this command is one of them

    Parser("completion", "Print a script that completes commands and options.", EXAMPLES).parse_args(arguments)
    print(SCRIPT.format(commands=" ".join(COMMANDS)))
    return EXIT_OK
