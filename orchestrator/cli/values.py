"""From the words of a command line to values: the types of options."""

from __future__ import annotations

import argparse
import math
import re
import shutil
from collections.abc import Callable
from fractions import Fraction
from functools import cached_property
from textwrap import fill
from typing import Any

from ..errors import InputError
from ..exact_time import seconds
from ..search.candidates import Range, check_range

MAX_LIMIT = 1e9
"""The largest limit: seconds and megabytes that the system can still count."""


MAX_SEEDS = 10_000
"""The largest number of seeds of one command; more are taken as a typing error."""

MAX_VALUES = 10_000
"""Values of one parameter, likewise."""


class Parser(argparse.ArgumentParser):
    """A parser of a ``command``, or of what is started as a ``program``.

    ``--help`` explains the common options and names the rare ones, which ``--help-all`` explains, too. Error messages
    have two lines.
    """

    def __init__(self, command: str, description: str, epilog: str = "", program: str = "") -> None:
        super().__init__(
            prog=program or f"flexible-manipulator {command}",
            description=description,
            epilog=epilog,
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )
        self._rare: list[argparse._ArgumentGroup] = []
        self.add_argument("--help-all", action=_HelpAll, nargs=0, help="show this message with all options explained")

    @cached_property
    def rare(self) -> argparse._ArgumentGroup:
        """The group of the options that few need."""
        return self.add_rare_group("more options")

    def add_rare_group(self, title: str, description: str | None = None) -> argparse._ArgumentGroup:
        """Add a group of options that few need; the help has it behind all other groups."""
        self._rare.append(self.add_argument_group(title, description))
        return self._rare[-1]

    def format_help(self, whole: bool = False) -> str:
        """The help; if it is the ``whole`` one, the rare options are explained."""
        # One word stands for the options in the usage: all of them took up to a fifth of the help.
        formatter = self.formatter_class(prog=f"{self.prog} [OPTION ...]")
        needed = [action for action in self._actions if action.required or not action.option_strings]
        formatter.add_usage(self.usage, needed, [])
        formatter.add_text(self.description)
        for group in sorted(self._action_groups, key=self._rare.__contains__):
            named = group in self._rare and not whole
            formatter.start_section(f"{group.title} (--help-all explains them)" if named else group.title)
            formatter.add_text(_names(group) if named else group.description)
            formatter.add_arguments([] if named else group._group_actions)
            formatter.end_section()
        formatter.add_text(self.epilog)
        return formatter.format_help()

    def error(self, message: str) -> None:  # type: ignore[override]  # it does not return either
        self.exit(2, f"error: {message}\n{self.prog} --help shows the options\n")


class _HelpAll(argparse.Action):
    def __call__(self, parser: argparse.ArgumentParser, *_: Any) -> None:
        assert isinstance(parser, Parser)
        print(parser.format_help(whole=True), end="")
        parser.exit()


def _names(group: argparse._ArgumentGroup) -> str:
    """The options of a group by name, in lines that fit the terminal with their indentation."""
    names = ", ".join(action.option_strings[-1] for action in group._group_actions)
    return fill(names, shutil.get_terminal_size().columns - 4, break_on_hyphens=False)


def time(text: str) -> Fraction:
    """A non-negative time in seconds, exact: ``0.00025`` or ``1/3000``."""
    try:
        value = seconds(text)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a time in seconds, such as 0.00025 or 1/3000") from None
    if value < 0:
        raise argparse.ArgumentTypeError(f"{text} is negative")
    return value


LENGTHS = {"in": 1.0, "mm": 1 / 25.4, "cm": 1 / 2.54, "pt": 1 / 72.27}
"""Units of a length on paper [inch]; the point is TeX's."""

LEAST_WIDTH, MOST_WIDTH = 2.0, 20.0
"""Widths of a figure [inch]."""


def widths(text: str) -> tuple[float, float]:
    """Two lengths as ``3.5in,7.16in``, in inches: the widths of one column of text and of two."""
    matches = [re.fullmatch(r"\s*(\d+\.?\d*)\s*(in|mm|cm|pt)\s*", part) for part in text.split(",")]
    values = [float(match[1]) * LENGTHS[match[2]] for match in matches if match]
    if len(values) != 2 or len(matches) != 2:
        raise argparse.ArgumentTypeError(f"{text!r} is not two widths, such as 3.5in,7.16in or 88mm,180mm")
    one, two = values
    if not LEAST_WIDTH <= one <= two <= MOST_WIDTH:
        limits = f"{LEAST_WIDTH:g} in to {MOST_WIDTH:g} in"
        raise argparse.ArgumentTypeError(f"{text!r}: widths are from {limits}, and two columns wider than one")
    return one, two


def connection(text: str) -> tuple[str, str]:
    """``CONNECTOR=VARIABLE`` as a pair."""
    connector, equals, variable = text.partition("=")
    if not (equals and connector.strip() and variable.strip()):
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form CONNECTOR=VARIABLE, such as q_m[1]=In1")
    return connector.strip(), variable.strip()


def setting(text: str) -> tuple[str, str]:
    """``NAME=VALUE`` as a pair of texts: what the value may be depends on the variable."""
    name, equals, value = text.partition("=")
    if not equals or not name.strip():
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=VALUE, such as K_p[1]=45 or enable=true")
    return name.strip(), value


def assignment(text: str) -> tuple[str, float]:
    """``NAME=NUMBER`` as a pair."""
    name, equals, value = text.partition("=")
    try:
        if not equals or not name:
            raise ValueError
        return name.strip(), float(value)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not of the form NAME=NUMBER, such as K_p[1]=45") from None


def assignments(text: str) -> list[tuple[str, float]]:
    """``NAME=VALUE`` or several of them, separated by commas, as pairs."""
    # A comma divides only before a name: a list of numbers is one value.
    return [assignment(part) for part in re.split(r",\s*(?=[A-Za-z_])", text)]


def variation(text: str) -> tuple[str, Range]:
    """``NAME=LOW:HIGH`` or ``NAME=LOW:HIGH:log`` as a pair."""
    name, equals, ends = text.partition("=")
    low, _, rest = ends.partition(":")
    high, colon, scale = rest.partition(":")
    try:
        if not equals or not name or (colon and scale != "log"):
            raise ValueError
        limits = Range(float(low), float(high), log=bool(colon))
    except ValueError:
        message = f"{text!r} is not of the form NAME=LOW:HIGH or NAME=LOW:HIGH:log, such as K_p[1]=20:80:log"
        raise argparse.ArgumentTypeError(message) from None
    return name.strip(), limits


def grid_values(text: str) -> tuple[str, tuple[float, ...]]:
    """``NAME=LOW:HIGH:COUNT``, ``NAME=LOW:HIGH:COUNT:log`` or ``NAME=VALUE,VALUE,...`` as a pair."""
    name, equals, rest = text.partition("=")
    ends, scale = (rest[: -len(":log")], True) if rest.endswith(":log") else (rest, False)
    try:
        if not equals or not name:
            raise ValueError
        if ":" not in ends and not scale:
            return name.strip(), tuple(map(float, rest.split(",")))
        low, high, count = ends.split(":")
        limits = Range(float(low), float(high), scale)
    except ValueError:
        message = f"{text!r} is not of the form NAME=LOW:HIGH:COUNT[:log] or NAME=VALUE,VALUE, such as K_p[1]=20:80:5"
        raise argparse.ArgumentTypeError(message) from None
    # What has the form is told what is wrong with its numbers: 1:2:99999 was called not of the form LOW:HIGH:COUNT.
    try:
        return name.strip(), check_range(name, limits).spaced(natural(2, MAX_VALUES)(count))
    except InputError as problem:
        raise argparse.ArgumentTypeError(str(problem)) from None


def natural(least: int = 0, most: float = math.inf) -> Callable[[str], int]:
    """The type of an option: a whole number from ``least`` to ``most``."""

    def parse(text: str) -> int:
        # Not int(), which takes signs, blanks and "1_000".
        if not text.isdecimal() or not least <= int(text) <= most:
            limit = f" to {most:g}" if most < math.inf else " on"
            raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {least}{limit}")
        return int(text)

    return parse


def seeds(text: str) -> tuple[int, ...]:
    """Seeds as a list of numbers and ranges, ``0,3,5-7``, each once."""
    listed: dict[int, None] = {}
    for part in text.split(","):
        first, dash, last = part.partition("-")
        ends = (first, last if dash else first)
        # Before int(): a number of thousands of digits takes seconds.
        if not all(end.isdecimal() and len(end) < 16 for end in ends) or int(ends[0]) > int(ends[1]):
            raise argparse.ArgumentTypeError(f"{text!r} is not a list of seeds, such as 0-9 or 0,3,5-7")
        if int(ends[1]) - int(ends[0]) + len(listed) >= MAX_SEEDS:
            raise argparse.ArgumentTypeError(f"{text} are more than {MAX_SEEDS} seeds")
        listed.update(dict.fromkeys(range(int(ends[0]), int(ends[1]) + 1)))
    return tuple(listed)


def number(
    least: float = -math.inf,
    infinite: bool = False,
    most: float = math.inf,
    above: float | None = None,
    below: float | None = None,
) -> Callable[[str], float]:
    """The type of an option: a finite number (or ``infinite``, too) from ``least`` to ``most``, ``above`` and ``below``
    what is given."""

    def parse(text: str) -> float:
        try:
            value = float(text)
        except ValueError:
            value = math.nan
        if math.isnan(value) or (math.isinf(value) and not infinite):
            raise argparse.ArgumentTypeError(f"{text!r} is not a finite number")
        if above is not None and value <= above:
            raise argparse.ArgumentTypeError(f"{text} is not above {above:g}")
        if below is not None and value >= below:
            raise argparse.ArgumentTypeError(f"{text} is not below {below:g}")
        if value < least:
            raise argparse.ArgumentTypeError(f"{text} is below {least:g}")
        if value > most:
            raise argparse.ArgumentTypeError(f"{text} is above {most:g}")
        return value

    return parse
