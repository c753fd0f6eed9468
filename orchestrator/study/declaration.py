"""A study is declared once: the fields of a frozen dataclass are its options, for the library and for the command.

Default, bounds, choices and help stand at the field. From there the command has its options, the documentation its
parameters, and every caller the same checks.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields
from pathlib import Path
from textwrap import fill
from typing import Any, ClassVar, Generic, TypeVar

from ..entry import enter_fields
from ..errors import InputError, unknown
from ..pairing.controller import Controller
from ..pairing.testbed import Testbed
from .requests import Requests

T = TypeVar("T")
Kind = TypeVar("Kind", bound="type[Study[Any]]")
S = TypeVar("S", bound="Study[Any]")


@dataclass(frozen=True)
class Option:
    """What a field says beside its type and default.

    A number is at ``least`` and at ``most`` so much, ``above`` and ``below`` so much, a text one of ``choices``. The
    command calls the option by its ``word``, by default the field's name, and has none if ``asked`` is false. What is
    on by default it can only switch off; the help of that is ``off``. Of options that ``exclude`` each other it takes
    one. A ``rare`` one is explained where all are.
    """

    help: str
    least: float | None = None
    most: float | None = None
    above: float | None = None
    below: float | None = None
    choices: tuple[str, ...] = ()
    word: str = ""
    off: str = ""
    metavar: str = ""
    exclude: str = ""
    required: bool = False
    rare: bool = False
    asked: bool = True

    def problem(self, value: Any) -> str:
        """What ``value`` must be and is not; empty if it is all right."""
        if self.least is not None and value < self.least:
            return f"at least {self.least:g}"
        if self.most is not None and value > self.most:
            return f"at most {self.most:g}"
        if self.above is not None and value <= self.above:
            return f"above {self.above:g}"
        if self.below is not None and value >= self.below:
            return f"below {self.below:g}"
        given = (value,) if isinstance(value, str) else value
        if self.choices and any(choice not in self.choices for choice in given):
            return f"one of {', '.join(self.choices)}"
        return ""


def option(default: Any, help: str, **rest: Any) -> Any:
    """A field with its :class:`Option`; a ``default`` that is a function is called for each study."""
    metadata = {"option": Option(help, **rest)}
    return (
        field(default_factory=default, metadata=metadata)
        if callable(default)
        else field(default=default, metadata=metadata)
    )


@dataclass(frozen=True)
class Study(Generic[T]):
    """A study with its options; :meth:`ask` makes the requests that it comes to its document by.

    Raises :class:`InputError` for an option that cannot be.

    ``command`` is the name of its command, whose results stand in a folder with a ``suffix``. ``protocol_option`` names
    the field, if there is one, that is the protocol in place of the benchmark's. A study ``on_this_machine`` is no work
    for a cluster, and takes nothing from an earlier run.
    """

    command: ClassVar[str] = ""
    suffix: ClassVar[str] = ""
    protocol_option: ClassVar[str] = ""
    on_this_machine: ClassVar[bool] = False

    def __post_init__(self) -> None:
        enter_fields(self)
        for name, declared in options(type(self)).items():
            value = getattr(self, name)
            # Here, not in the command: reliability(probability=0) from Python ended in a TypeError of SciPy.
            if value is not None and (problem := declared.problem(value)):
                code = "bad-option" if declared.choices else "bad-number"
                raise InputError(f"{name} must be {problem}, not {shown(value)}.", code, name, value, declared.choices)
        self._check_exclusion()

    def _check_exclusion(self) -> None:
        given: dict[str, list[str]] = {}
        for attribute in fields(self):
            group = attribute.metadata["option"].exclude if "option" in attribute.metadata else ""
            if group and getattr(self, attribute.name) != default(attribute):
                given.setdefault(group, []).append(attribute.name)
        for names in given.values():
            if len(names) > 1:  # from Python, the last one silently counted
                raise InputError(f"{' and '.join(names)} exclude each other: give one of them.", "contradiction")

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[T]:
        """The requests of the study, which returns its document; ``folder`` is where an earlier run may be."""
        raise NotImplementedError


def made(study: type[S], method: str, *given: Any, **named: Any) -> S:
    """A ``study`` of the options that were given to a ``method`` of Benchmark.

    Raises :class:`InputError` for an option that there is not, by the names that the caller knows.
    """
    names = [attribute.name for attribute in fields(study)]
    for name in named:
        if name not in names:
            raise unknown(f"Benchmark.{method} has no option {name}.", "no-option", method, name, names)
    return study(*given, **named)


def shown(value: Any) -> str:
    """An option's value in a message."""
    return f"{value:g}" if isinstance(value, float) else str(value) if isinstance(value, int | str) else repr(value)


def options(study: type[Study[Any]]) -> dict[str, Option]:
    """The options of a study by the names of their fields."""
    return {
        attribute.name: attribute.metadata["option"] for attribute in fields(study) if "option" in attribute.metadata
    }


def default(of: Field[Any]) -> Any:
    """The default of a field."""
    return of.default if of.default is not MISSING else of.default_factory() if callable(of.default_factory) else None


def described(study: Kind) -> Kind:
    """``study`` with its options in its docstring."""
    lines = [study.__doc__ or "", "", "    Parameters", "    ----------"]
    for attribute in fields(study):
        told = attribute.metadata["option"]
        kind = f"one of {', '.join(map(repr, told.choices))}" if told.choices else str(attribute.type)
        value = default(attribute)
        lines += [f"    {attribute.name} : {kind}" + ("" if isinstance(value, Mapping) else f", default {value!r}")]
        lines += [
            fill(f"{told.help[0].upper()}{told.help[1:]}.", 112, initial_indent=" " * 8, subsequent_indent=" " * 8)
        ]
    study.__doc__ = "\n".join(lines) + "\n    "
    return study
