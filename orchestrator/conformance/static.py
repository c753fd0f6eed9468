"""Findings from the archive and its description alone; no code of the FMU runs.

What the standard finds wrong with a description is FMPy's validation, summed up. FMPy parses names of the structured
convention with a grammar, which takes milliseconds for each. A regular expression of the same language takes
microseconds; it is used instead.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Iterator, Sequence
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import fmpy
from fmpy.model_description import ModelDescription, ValidationError

from ..fmi.archive import Archive
from ..fmi.connectors import CONTROLLER, Binding
from ..fmi.description import declared_capabilities, illegal_combinations, uncollected
from ..fmi.host import wine
from ..fmi.library import NATIVE, SOURCE, has_sources
from ..fmi.symbols import shadowed
from ..fmi.variables import Variable, variables
from ..loop.sampling import FIXED, SampleTime
from ..loop.setup import Setup, held_inputs, sample_time_parameter
from ..text import shortened
from .finding import Finding, Severity

MAX_NAMED = 5
"""Largest number of variables that a finding names."""

MAX_LISTED = 40
"""The same of a list of parameters."""


MAX_PER_KIND, MAX_KINDS, MAX_PROBLEM_LENGTH = 3, 10, 500
"""Problems of one kind that are named, kinds that are, and characters of a problem."""

_NAME = r"[A-Za-z_][A-Za-z0-9_]*"

_QUOTED = r"""'(?:[A-Za-z0-9_!#$%&()*+,./:;<=>?@\[\]^{}|~ -]|\\['"?\\abfnrtv])+'"""

_INDICES = r"(?:\[[0-9]+(?:,[0-9]+)*\])?"

_PART = rf"(?:{_NAME}|{_QUOTED}){_INDICES}"

_IDENTIFIER = rf"{_PART}(?:\.{_PART})*"

STRUCTURED = re.compile(rf"{_IDENTIFIER}|der\({_IDENTIFIER}(?:,[0-9]+)?\)")
"""Names of the structured convention, FMI 2.0.4, section 2.2.9, and FMI 3.0, section 2.4.7.5.1."""

_OWN_WORDS = re.compile(r"\"[^\"]*\"|'[^']*'|[0-9]+")
"""What differs between problems of one kind."""


def archive_findings(archive: Archive) -> Iterator[Finding]:
    """Version, tool, platforms, capabilities, and what FMPy's validation says."""
    description = archive.description
    tool = description.generationTool or "an unnamed tool"
    kind = "co-simulation" if archive.kind == "CoSimulation" else "Model Exchange"
    yield Finding(Severity.OK, "standard", f"FMI {description.fmiVersion} {kind}, exported by {tool}")
    platform = _platform(archive)
    if archive.platforms:
        yield Finding(Severity.OK, "platforms", f"{', '.join(archive.platforms)} (this one: {platform})")
    else:
        yield Finding(Severity.NOTE, "platforms", f"source code only, compiled here for {platform}")
    yield _library(archive)
    if names := shadowed(archive.library_file):
        text = f"the library has names of other libraries, {_some(names)}; here it finds its own by them"
        remedy = "Hide what is not of FMI (-fvisibility=hidden), or link with -Wl,-Bsymbolic: other importers may call "
        remedy += "the others."
        yield Finding(Severity.NOTE, "symbols", text, remedy)
    if str(archive.interface.needsExecutionTool).lower() in ("true", "1"):
        text = "the FMU declares that it needs a tool of its exporter at run time (a Python FMU needs Python)"
        remedy = "Make sure that it is installed wherever the FMU is to run."
        yield Finding(Severity.NOTE, "execution tool", text, remedy)
    yield from capability_findings(archive)
    if illegal := illegal_combinations(description):
        text = f"the standard has no such variables: {_some(illegal)}; their values are used"
        remedy = "Correct their causality or variability: other tools may refuse the FMU."
        yield Finding(Severity.WARNING, "variables", text, remedy)
    yield from _validation(archive)


def _platform(archive: Archive) -> str:
    """The name of this platform in the FMU's version of the standard."""
    return replace(archive, library=NATIVE).library_file.parent.name


def _library(archive: Archive) -> Finding:
    """Which library is loaded, and why."""
    platform = _platform(archive)
    if archive.library == NATIVE:
        return Finding(Severity.OK, "library", f"its own binary for {platform}")
    binary = replace(archive, library=NATIVE).library_file.is_file()
    why = "as asked for" if binary else f"as it has no binary for {platform}"
    if archive.library == SOURCE:
        return Finding(Severity.OK, "library", f"compiled here of its sources, {why}")
    if not binary and has_sources(archive.folder):
        why += " and its sources are not compiled"
    text = (
        f"runs under Wine {wine.version()}, {why}; results may differ in the last bits from those on Windows, because "
    )
    text += "its mathematical library is Wine's"
    return Finding(Severity.NOTE, "library", text, f"Export it for {platform}, and it runs without Wine.")


def binding_findings(binding: Binding, archive: Archive, setup: Setup) -> Iterator[Finding]:
    """Which variables the connectors are bound to, with units and start values; what is absent."""
    for connector in CONTROLLER:
        bound = binding.get(connector.name)
        if bound is None:
            # Absent, since the other of the two is there.
            if connector.name == "e" or (connector.name in ("q_m", "q_m_ref") and "e" in binding):
                continue
            yield Finding(Severity.NOTE, connector.name, f"absent ({connector.meaning}); it is optional")
            continue
        names = ", ".join(_described(variable) for variable in bound.variables)
        yield Finding(Severity.OK, connector.name, f"{names} ({bound.spelled})")
        for note in bound.notes:
            yield Finding(Severity.NOTE, connector.name, note, f"Declare the unit {connector.unit}.")
    T_s = sample_time_parameter(archive, setup)
    if T_s is not None:
        yield Finding(Severity.OK, "T_s", f"{_described(T_s)}; set to the sample time")
    yield from value_findings(binding, archive, setup)


def value_findings(binding: Binding, archive: Archive, setup: Setup) -> Iterator[Finding]:
    """What was given, which inputs nothing drives, and which parameters can be set beside."""
    if setup.parameters:
        values = ", ".join(f"{name} = {shortened(value)}" for name, value in setup.parameters.items())
        yield Finding(Severity.OK, "parameters", values)
    held = held_inputs(archive, setup, binding)
    start = {name: value for name, value in held.items() if name not in setup.parameters}
    if given := [name for name in held if name in setup.parameters]:
        yield Finding(Severity.OK, "inputs", f"{', '.join(given)}: set as given, and held")
    by_name = variables(archive.description)
    declared = {name: by_name.get(name) or by_name[name.partition("[")[0]] for name in start}
    words = {
        name: name if value is None else f"{name} = {declared[name].spelled(value)}" for name, value in start.items()
    }
    # Apart, for what helps: a number may be a connector by another name, a switch is set.
    for what, is_number in (("undriven-input", True), ("undriven-switch", False)):
        if names := [name for name, variable in declared.items() if variable.is_real is is_number]:
            text = f"nothing drives {_some([words[name] for name in names])}: held at the start value"
            yield Finding(Severity.WARNING, "inputs", text, what=what, value=names[0])
    T_s = sample_time_parameter(archive, setup)
    connected = {variable for bound in binding.values() for variable in bound.variables}
    further = [
        _described(variable)
        for variable in variables(archive.description).values()
        if variable.causality == "parameter" and variable.can_be_set and variable not in connected
        if variable is not T_s
    ]
    if further:
        yield Finding(Severity.OK, "can be set", _some(further, MAX_LISTED))


def capability_findings(archive: Archive) -> Iterator[Finding]:
    """The flags that the FMU declares, by what the master makes of them."""
    standings: dict[str, list[str]] = {}
    for capability, _ in declared_capabilities(archive.folder):
        standings.setdefault(capability.standing, []).append(capability.name)
    if standings:
        text = "; ".join(f"{standing}: {', '.join(names)}" for standing, names in sorted(standings.items()))
        yield Finding(Severity.OK, "capabilities", text)


def _some(words: list[str], most: int = MAX_NAMED) -> str:
    """The first of many words, and how many more there are."""
    return ", ".join(words[:most]) + (f" and {len(words) - most} more" if len(words) > most else "")


def sampling_findings(sample_time: SampleTime, benchmark: Fraction) -> Iterator[Finding]:
    """The sample time and where it comes from."""
    text = f"{float(sample_time.value) * 1e3:g} ms ({sample_time.origin})"
    if sample_time.value == benchmark:
        yield Finding(Severity.OK, "sample time", text)
    else:
        text += f", not the benchmark's {float(benchmark) * 1e3:g} ms; every result will be marked"
        remedy = f"Export the controller with {float(benchmark):g} s to be comparable."
        what = "" if sample_time.origin in ("given", FIXED) else "other-sample-time"
        yield Finding(Severity.WARNING, "sample time", text, remedy, what=what, value=f"{float(benchmark):g}")


def _validation(archive: Archive) -> Iterator[Finding]:
    problems = validation_problems(archive.file, archive.description)
    if not problems:
        yield Finding(Severity.OK, "description", "valid")
    for text in summed_up(problems):
        yield Finding(Severity.NOTE, "description", text, "Report it to the exporter's maker.")


def _described(variable: Variable) -> str:
    shape = f"[{variable.size}]" if variable.size > 1 else ""
    start = f" = {', '.join(map(variable.spelled, variable.start))}" if variable.start else ""
    return f"{variable.name}{shape} [{(variable.unit or '?') if variable.is_real else variable.type}]{start}"


def validation_problems(file: Path, description: ModelDescription) -> list[str]:
    """What is wrong with the FMU ``file``, which has this ``description``; empty if nothing is."""
    return [*_backslashes(file), *_illegal_names(description), *_invalid(file)]


def summed_up(problems: Sequence[str]) -> Iterator[str]:
    """One text for the problems of each kind: the first few, and how many more there are."""
    kinds: dict[str, list[str]] = {}
    for problem in problems:
        # 20,000 variables with the same flaw were 20,000 rows: without names and numbers their texts are equal.
        kinds.setdefault(_OWN_WORDS.sub("", problem), []).append(problem)
    for alike in list(kinds.values())[:MAX_KINDS]:
        more = [f"and {len(alike) - MAX_PER_KIND} more of this kind"] if len(alike) > MAX_PER_KIND else []
        yield "\n".join((*(problem[:MAX_PROBLEM_LENGTH] for problem in alike[:MAX_PER_KIND]), *more))
    if len(kinds) > MAX_KINDS:
        left = sum(map(len, list(kinds.values())[MAX_KINDS:]))
        yield f"{left} more problems of {len(kinds) - MAX_KINDS} more kinds"


def _backslashes(file: Path) -> list[str]:
    with zipfile.ZipFile(file) as archive:
        # zipfile has replaced backslashes in `filename` on Windows; the name as it stands in the file is this one.
        names = [member.orig_filename for member in archive.infolist()]
    return [f'The file path "{name}" contains a backslash.' for name in names if "\\" in name]


def _illegal_names(description: ModelDescription) -> list[str]:
    names = [variable.name for variable in description.modelVariables]
    if description.variableNamingConvention == "structured":
        illegal = (name for name in names if not STRUCTURED.fullmatch(name))
        return [f'"{name}" is not a legal variable name for the naming convention "structured".' for name in illegal]
    illegal = (name for name in names if re.search(r"[\r\n\t]", name))
    return [f'The variable name "{" ".join(name.split())}" has a tab or a line end.' for name in illegal]


def _invalid(file: Path) -> list[str]:
    try:
        with uncollected():  # as for read_description
            fmpy.read_model_description(str(file), validate=True, validate_model_structure=True)
    except ValidationError as invalid:
        problems = invalid.problems
    except Exception as failure:  # FMPy's validation itself trips over some descriptions
        problems = [str(failure) or type(failure).__name__]
    else:
        return []
    lines = [line for problem in problems for line in problem.splitlines() if not line.endswith(":")]
    return [" ".join(line.split()) for line in lines if line.strip()]
