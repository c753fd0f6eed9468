"""A controller FMU, and how it is used; the benchmark's own ones as the references of others."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import cached_property
from pathlib import Path

from build_fmus import find_compiler

from ..codec import Scalar
from ..documents.document import Displayable
from ..entry import enter_fields, entered
from ..errors import InputError
from ..exact_time import seconds
from ..fmi.archive import Archive, open_archive
from ..fmi.controller_files import read_mapped_parameters, read_mapping, read_parameters
from ..fmi.library import LIBRARIES, LibraryKind
from ..fmi.lookup import canonical_values, elements
from ..fmi.variables import variables
from ..loop.setup import Setup
from ..views.table import Cell, Column, Note, Part, Summary, Table, Value
from .built_in import DEFAULT_CONTROLLER, built_in, fastest_default

IN_C = {
    "DiagonalPID": "DiagonalPID_C",
    "TunedPID": "DiagonalPID_C",
    "DitheredLQG": "DitheredLQG_C",
    "ManipulatorLQG": "",
}
"""The references, each with the FMU in C that can take its place: the same to the last bit for the PIDs, up to rounding
for the LQG."""


@dataclass(frozen=True)
class Controller(Displayable):
    """A controller FMU of any tool, with its parameters and the meaning of its variables.

    Parameters
    ----------
    file : path, optional
        The FMU; by default the paper's PID, built on first use: in C where there is a compiler that gives the bits of
        the one in Python.
    parameters : mapping or path, optional
        Values by name, in the FMU's units, of parameters, and of inputs that nothing drives: ``{"K_p[1]": 60,
        "enable": True, "mode": "Manual"}``, of an array by element or as a list; or a ``.toml`` or ``.ssv`` file.
    mapping : mapping or path, optional
        Variables by connector, where their names differ: ``{"q_m[1]": "In1"}``; or a ``.toml`` or ``.ssm`` file. A
        ``.toml`` file may give parameters, too.
    sample_time : number, str or Fraction, optional
        Sample time [s]; by default the FMU's own, or else the benchmark's.
    library : "native", "source" or "wine", optional
        Which of its libraries is loaded: the binary for this platform, one compiled of its sources, or the binary for
        Windows, under Wine; by default the first of these that can be.

    Raises
    ------
    InputError
        If a number is not finite. Whether a value is one that its variable takes, and what is wrong with the FMU
        itself, shows when it is first used.
    """

    file: str | Path | None = None
    parameters: Mapping[str, Scalar | Sequence[Scalar]] | str | Path = field(default_factory=dict)
    mapping: Mapping[str, str] | str | Path = field(default_factory=dict)
    sample_time: Fraction | float | str | None = None
    library: LibraryKind | None = None

    def __post_init__(self) -> None:
        enter_fields(self)
        if self.library is not None and self.library not in LIBRARIES:
            message = f"The library of a controller is one of {', '.join(LIBRARIES)}, not {self.library!r}."
            raise InputError(message, "no-library", "", self.library, LIBRARIES)
        if self.library is not None and self.file is None:
            message = "The paper's PID is built here as it runs best: a choice of library is for the FMU in a file."
            raise InputError(message, "contradiction", "", self.library)
        if isinstance(self.parameters, Mapping):
            _check_finite(elements(self.parameters))

    @classmethod
    def of(cls, given: Given) -> Controller:
        """The controller that is ``given``, as such or as the path of an FMU; the paper's PID if there is none.

        Raises :class:`InputError` for anything else.
        """
        if given is None or isinstance(given, str | os.PathLike):
            return cls(given)
        if not isinstance(given, cls):
            message = f"A controller is a Controller or the path of an FMU, not a {type(given).__name__}."
            raise InputError(message, "no-controller", "", given)
        return given

    @classmethod
    def built_in(cls, name: str) -> Controller:
        """One of the benchmark's own controllers, such as ``"DitheredLQG"``; see :data:`build_fmus.NAMES`."""
        return cls(built_in(name))

    @entered
    def with_parameters(self, values: Mapping[str, Scalar]) -> Controller:
        """The same controller with ``values`` set on top of its own."""
        return replace(self, parameters={**self.setup.parameters, **values})

    @property
    def name(self) -> str:
        """The file's name without its ending; that of the paper's PID is the same in Python and in C."""
        return Path(self.file).stem if self.file is not None else DEFAULT_CONTROLLER

    @property
    def file_name(self) -> str:
        """The FMU's file name; that of the paper's PID tells its build."""
        return Path(self.file).name if self.file is not None else self.archive.name

    @cached_property
    def archive(self) -> Archive:
        """The FMU, checked and extracted; raises :class:`InputError` if it cannot be used."""
        return open_archive(Path(self.file), self.library) if self.file is not None else fastest_default()

    @cached_property
    def setup(self) -> Setup:
        """Parameters and mapping, read from their files if they are given so. Each value is as its type takes it, so
        that equal uses are recorded alike.

        Raises :class:`InputError` for a value that its variable does not take.
        """
        given, mapping = self.parameters, self.mapping
        if not isinstance(given, Mapping):
            values = read_parameters(Path(given), self.archive)
        else:
            description = self.archive.description if given else None  # which takes time to read
            values = elements(given, description, f"The controller {self.file_name}" if given else "")
        if not isinstance(mapping, Mapping):
            # What is given beside the file takes precedence over what it says.
            values = {**read_mapped_parameters(Path(mapping), self.archive), **values}
            mapping = read_mapping(Path(mapping))
        if values:
            values = canonical_values(self.archive.description, values, f"The controller {self.archive.name}")
        return Setup(values, dict(mapping))

    @property
    def given_sample_time(self) -> Fraction | None:
        """The sample time [s] that was asked for."""
        return None if self.sample_time is None else seconds(self.sample_time)

    def summary(self) -> Summary:
        """FMI version and tool of the FMU, and its parameters; or why the FMU cannot be used."""
        try:
            description, parts = self.archive.description, self._parts()
        except InputError as problem:
            return Summary(self.file_name, "cannot be used", (Note(str(problem)),))
        kicker = f"FMI {description.fmiVersion}, {description.generationTool or 'unknown tool'}"
        return Summary(self.file_name, kicker, parts)

    def _parts(self) -> tuple[Part, ...]:
        given, mapping = self.setup.parameters, self.setup.mapping
        rows: tuple[tuple[Cell, ...], ...] = tuple(
            (
                variable.name,
                variable.spelled(given.get(variable.name, variable.start[0]))
                if variable.items or not variable.is_real
                else Value(float(given.get(variable.name, variable.start[0])), given=True),
                variable.unit or "-",
                "given" if variable.name in given else "of the FMU",
            )
            for variable in variables(self.archive.description).values()
            if variable.causality == "parameter" and len(variable.start) == 1
        )
        columns = tuple(map(Column, ("parameter", "value", "unit", "whose value")))
        parts: list[Part] = [Table("Parameters", columns, rows)]
        if mapping:
            parts.append(Table("Mapping", (Column("connector"), Column("variable")), tuple(mapping.items())))
        if self.given_sample_time is not None:
            parts.append(Note(f"Sample time: {float(self.given_sample_time):g} s.", warning=False))
        return tuple(parts)


Given = Controller | str | Path | None
"""A controller, the path of one, or the paper's PID."""


def _check_finite(parameters: Mapping[str, Scalar]) -> None:
    for name, value in parameters.items():
        if isinstance(value, float) and not math.isfinite(value):
            raise InputError(
                f"The value of the parameter {name}, {value}, is not a finite number.", "not-finite", name, value
            )


def reference(name: str) -> Controller:
    """The controller called ``name``; raises :class:`InputError` for one that is none of :data:`IN_C`."""
    if name not in IN_C:
        raise InputError(f"No reference is named {name}. There are: {', '.join(IN_C)}.", "no-reference", "", name, IN_C)
    original = Controller.built_in(name)
    return in_c(original, Controller.built_in(IN_C[name])) if IN_C[name] and find_compiler() is not None else original


def in_c(original: Controller, twin: Controller) -> Controller:
    """The controller ``twin`` with the parameters that ``original`` begins with."""
    common = _starts(twin)
    changes = {key: value for key, value in _starts(original).items() if value != common.get(key, value)}
    return replace(twin, parameters=changes)


def _starts(controller: Controller) -> dict[str, float]:
    variables = controller.archive.description.modelVariables
    return {variable.name: float(variable.start) for variable in variables if variable.causality == "parameter"}
