"""Findings from the archive and its description alone; no code of the FMU runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from ..fmi.archive import Archive
from ..fmi.connectors import CONTROLLER, Binding
from ..fmi.description import declared_capabilities, illegal_combinations
from ..fmi.host import wine
from ..fmi.library import NATIVE, SOURCE, has_sources
from ..fmi.variables import Variable, variables
from ..loop.sampling import FIXED, SampleTime
from ..loop.setup import Setup, held_inputs, sample_time_parameter
from ..text import shortened
from .finding import Finding, Severity
from .validation import summed_up, validation_problems

MOST_NAMED = 5
"""Largest number of variables that a finding names."""

MOST_LISTED = 40
"""The same of a list of parameters."""


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
    if start:
        known = variables(archive.description)
        words = [
            name if value is None else f"{name} = {(known.get(name) or known[name.partition('[')[0]]).spelled(value)}"
            for name, value in start.items()
        ]
        text = f"nothing drives {_some(words)}: held at the start value"
        yield Finding(Severity.WARNING, "inputs", text, what="undriven-input", value=next(iter(start)))
    T_s = sample_time_parameter(archive, setup)
    connected = {variable for bound in binding.values() for variable in bound.variables}
    further = [
        _described(variable)
        for variable in variables(archive.description).values()
        if variable.causality == "parameter" and variable.can_be_set and variable not in connected
        if variable is not T_s
    ]
    if further:
        yield Finding(Severity.OK, "can be set", _some(further, MOST_LISTED))


def capability_findings(archive: Archive) -> Iterator[Finding]:
    """The flags that the FMU declares, by what the master makes of them."""
    standings: dict[str, list[str]] = {}
    for capability, _ in declared_capabilities(archive.folder):
        standings.setdefault(capability.standing, []).append(capability.name)
    if standings:
        text = "; ".join(f"{standing}: {', '.join(names)}" for standing, names in sorted(standings.items()))
        yield Finding(Severity.OK, "capabilities", text)


def _some(words: list[str], most: int = MOST_NAMED) -> str:
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
