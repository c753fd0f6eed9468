"""Findings from the archive and its description alone; no code of the FMU runs."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction

from ..fmi.archive import Archive
from ..fmi.choice import NATIVE, SOURCE, has_sources
from ..fmi.connectors import CONTROLLER, Binding
from ..fmi.description import illegal_combinations
from ..fmi.host import wine
from ..fmi.variables import Variable
from ..loop.sampling import SampleTime
from ..loop.setup import Setup, sample_time_parameter
from .finding import Finding, Severity
from .validation import summed_up, validation_problems

MOST_NAMED = 5
"""Largest number of variables that a finding names."""


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
    if illegal := illegal_combinations(description):
        more = f" and {len(illegal) - MOST_NAMED} more" if len(illegal) > MOST_NAMED else ""
        text = f"the standard has no such variables: {', '.join(illegal[:MOST_NAMED])}{more}; their values are used"
        remedy = "Correct their causality or variability: other tools may refuse the FMU."
        yield Finding(Severity.WARNING, "variables", text, remedy)
    yield from _validation(archive)


def _platform(archive: Archive) -> str:
    """The name of this platform in the FMU's version of the standard."""
    return replace(archive, way=NATIVE).library.parent.name


def _library(archive: Archive) -> Finding:
    """Which library is loaded, and why."""
    platform = _platform(archive)
    if archive.way == NATIVE:
        return Finding(Severity.OK, "library", f"its own binary for {platform}")
    binary = replace(archive, way=NATIVE).library.is_file()
    why = "as asked for" if binary else f"as it has no binary for {platform}"
    if archive.way == SOURCE:
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
    if setup.parameters:
        values = ", ".join(f"{name} = {value:g}" for name, value in setup.parameters.items())
        yield Finding(Severity.OK, "parameters", values)


def sampling_findings(sample_time: SampleTime, benchmark: Fraction) -> Iterator[Finding]:
    """The sample time and where it comes from."""
    text = f"{float(sample_time.value) * 1e3:g} ms ({sample_time.origin})"
    if sample_time.value == benchmark:
        yield Finding(Severity.OK, "sample time", text)
    else:
        text += f", not the benchmark's {float(benchmark) * 1e3:g} ms; every result will be marked"
        remedy = f"Export the controller with {float(benchmark):g} s to be comparable."
        yield Finding(Severity.WARNING, "sample time", text, remedy)


def _validation(archive: Archive) -> Iterator[Finding]:
    problems = validation_problems(archive.file, archive.description)
    if not problems:
        yield Finding(Severity.OK, "description", "valid")
    for text in summed_up(problems):
        yield Finding(Severity.NOTE, "description", text, "Report it to the exporter's maker.")


def _described(variable: Variable) -> str:
    shape = f"[{variable.size}]" if variable.size > 1 else ""
    start = f" = {', '.join(f'{value:g}' for value in variable.start)}" if variable.start else ""
    return f"{variable.name}{shape} [{variable.unit or '?'}]{start}"
