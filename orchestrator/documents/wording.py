"""What all outputs say in words: values in the paper's units, how a document was made, what a reader must know, and why
requirements are not met or not judged."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

from plant_fmu.flexible_manipulator.parameters import TABLE_1

from ..benchmark.results import Verdict
from ..benchmark.scorecard import first_and_later
from ..codec import Scalar
from ..loop.behaviour import WORDS, CarryOver
from ..loop.trajectory import Status
from ..text import shortened
from ..views.table import VERDICTS, Note
from ..views.units import amplitude, number
from .head import ControllerRecord, Head
from .results import LoopDelay, Results

REQUIREMENTS = {
    "A1": "loop gain × {gain:g}, axis {axis}",
    "A2": "delay + {delay:g} ms, axis {axis}",
    "A3": "limit cycle, all tests",
}
"""What a requirement asks for."""

MOST_NAMED = 5
"""Largest number of inputs that a remark names."""

SEED_MATTERS = "its result depends on the seed"
"""What is said of protocols with few cases."""

SHOWN_FAILURES = 3
"""Cases that failed whose messages a summary shows."""

NO_UNIT = re.compile(r"(?:.*: )?(.+) declares no unit; taken as (.+)")


@dataclass(frozen=True)
class RequirementRow:
    """A requirement as it is listed: its name, its axis if it is judged per axis (else empty), title and verdict."""

    name: str
    axis: str
    title: str
    judged: Verdict

    @property
    def label(self) -> str:
        """Name and axis, such as ``A2 axis 1``."""
        return f"{self.name} axis {self.axis}" if self.axis else self.name

    @property
    def amplitude(self) -> str:
        """What the worst case did: its limit cycle, or why it has none that counts."""
        judged = self.judged
        if judged.worst_case is None:
            return "-"
        if judged.limit_cycle is None:
            return "no value"
        if judged.rest_error is not None:
            return f"no rest: {number(judged.rest_error * 1e3)} mm"
        seeds = f", {judged.seeds_failed} of {judged.seeds_tried} seeds" if judged.seeds_tried > 1 else ""
        rings = " (ring-down)" if judged.kind == "ring-down" else ""
        return f"{amplitude(judged.limit_cycle)}{rings}{seeds}"


def parameter_words(name: str) -> str:
    """What a parameter of Table 1 is: ``f_c[2]`` is the Coulomb motor friction of axis 2."""
    symbol, _, axis = name.removesuffix("]").partition("[")
    description = next((row.description for row in TABLE_1 if row.symbol == symbol), symbol)
    words = re.sub(rf" {symbol}\b|, (eq\.|Section).*", "", description)
    return f"{words}, axis {axis}" if axis else words


def loop_delay(delay: LoopDelay) -> str:
    """The loop delay in words."""
    if delay.seconds is None or delay.samples is None:
        return f"not measured: the controller {delay.convention or 'could not be probed'}"
    text = f"{delay.seconds * 1e3:.3f} ms = {delay.samples:g} sample{'s' * (delay.samples != 1)}"
    within = f" ({delay.controller_samples} of them in the controller)" if delay.controller_samples else ""
    return f"{text}{within}; the controller {delay.convention}"


def computing_time(results: Results) -> str:
    """The controller's computing time against its sample time."""
    time = results.timing.computing_time
    return "not measured" if time is None else f"{time.text} of {results.sample_time.seconds * 1e6:g} µs"


def connectors(controller: ControllerRecord) -> str:
    """The connectors that the controller has, and the optional ones that it does not have."""
    bound = [name for name, entry in controller.connectors.items() if entry is not None]
    absent = [name for name, entry in controller.connectors.items() if entry is None and name != "e"]
    return ", ".join(bound) + (f" (without {', '.join(absent)})" if absent else "")


def requirement_rows(results: Results) -> list[RequirementRow]:
    """The requirements, A1 and A2 per axis."""
    rows = []
    for name, entry in results.stability.items():
        tests = {str(test.axis): test for test in results.rules.tests if name in test.requirements}
        per_axis: list[tuple[str, Verdict]] = [*entry.axes.items()] if "{axis}" in REQUIREMENTS[name] else [("", entry)]
        for axis, judged in per_axis:
            test = tests.get(axis)
            gain, delay = (test.gain, test.delay * 1e3) if test else (1.0, 0.0)
            title = REQUIREMENTS[name].format(axis=axis, gain=gain, delay=delay)
            rows.append(RequirementRow(name, axis, title, judged))
    return rows


def without_cost(results: Results) -> str:
    """Why a complete run has no cost; empty if it has one."""
    if results.cost is not None or not results.complete:
        return ""
    criteria = {test.name for test in results.rules.tests if test.criteria}
    lost = sum(case.test in criteria and case.status != "done" for case in results.cases)
    if not lost:
        absent = (name for name, entry in results.criteria.items() if entry.value is None)
        return f"the protocol does not measure {', '.join(absent)}"
    return f"{lost} of the cases that B1 to B7 are measured in are unstable"


def incomplete(results: Results) -> str:
    """How many cases of the protocol were not simulated, by status."""
    ended = Counter(case.status.value for case in results.cases if not case.simulated)
    parts = [f"{count} ended with {status}" for status, count in ended.items()]
    if rest := results.rules.cases - len(results.cases):
        parts.append(f"{rest} {'was' if rest == 1 else 'were'} not run")
    return f"of the protocol's {results.rules.cases} cases, {', '.join(parts)}"


def collapsed(notes: Iterable[str]) -> list[str]:
    """Notes on connectors, those on variables without a unit in one line."""
    others: list[str] = []
    taken: dict[str, list[str]] = {}
    for note in dict.fromkeys(notes):
        if unitless := NO_UNIT.fullmatch(note):
            taken.setdefault(unitless[2], []).append(unitless[1])
        else:
            others.append(note)
    parts = (f"{', '.join(names)} (taken as {unit})" for unit, names in taken.items())
    return [*others, *([f"no unit declared: {'; '.join(parts)}"] if taken else [])]


def seed_words(head: Head) -> str:
    """The seed of a document."""
    return "several seeds" if head.seed is None else f"seed {head.seed}"


def assignments(values: Mapping[str, Scalar]) -> str:
    """Parameters and their values in one line."""
    return ", ".join(f"{name} = {shortened(value)}" for name, value in values.items())


def carry_over(head: Head) -> list[str]:
    """What a reader must know of how the simulations were kept apart."""
    if not head.carry_over.separates:
        return []
    cause = f"{head.controller.file}: {WORDS[head.carry_over]}"
    if head.carry_over is CarryOver.RANDOM:
        return [f"{cause}. These results cannot be repeated."]
    return [f"{cause}. Each simulation had a process of its own."]


def remarks(results: Results) -> list[str]:
    """What a reader must know before comparing the figures with others."""
    sentences = carry_over(results.head)
    unsettled = sum(case.measurements.settled is False for case in results.cases)
    if unsettled:
        cases = f"{unsettled} case{'s' * (unsettled != 1)}"
        end = "end of the simulation"
        if any(case.measurements.B6_later is not None for case in results.cases):
            end = f"next disturbance or the {end}"
        sentences.append(f"In {cases} B6 is the time to the {end}: the TCP did not settle.")
    if (both := first_and_later(results.cases)) is not None:
        first, later = both
        ratio = f", {number(later / first)} times as long" if first else ""
        sentences.append(
            f"B6 after the first force: {number(first)} s; after the later ones at most {number(later)} s{ratio}."
        )
    if not results.complete:
        sentences.append(f"Incomplete: {incomplete(results)}.")
    if reason := without_cost(results):
        sentences.append(f"No cost V: {reason}.")
    if not results.sample_time.as_in_benchmark:
        sentences.append(f"Sample time {results.sample_time.seconds * 1e3:g} ms, not the benchmark's: not comparable.")
    if results.protocol != "paper":
        others = "not comparable to the paper nor to other protocols"
        sentences.append(f"Protocol {results.protocol}: {others}; {SEED_MATTERS}.")
    bound = (entry for entry in results.controller.connectors.values() if entry is not None)
    notes = collapsed(note for entry in bound for note in entry.notes)
    sentences += [f"{note[0].upper()}{note[1:]}." for note in notes if note]
    start = [name for name in results.controller.held if name not in results.controller.parameters]
    if start:
        more = f" and {len(start) - MOST_NAMED} more" if len(start) > MOST_NAMED else ""
        kept = f"{', '.join(start[:MOST_NAMED])}{more}"
        sentences.append(f"Nothing drives the controller's input {kept}: it kept its start value.")
    if results.plant.path:
        sentences.append(f"The plant is {results.plant.file}, not the benchmark's: not comparable.")
    if changes := assignments(results.plant.parameters):
        sentences.append(f"The plant's nominal parameters were changed ({changes}): not comparable.")
    return sentences


def head_facts(head: Head) -> Iterator[tuple[str, str]]:
    """The facts of a head."""
    controller, plant, timing, sample_time = head.controller, head.plant, head.timing, head.sample_time
    processes = "1 process" if timing.workers == 1 else f"{timing.workers} processes"
    yield "Controller", controller.file
    yield "Parameters set", assignments(controller.parameters) or "none"
    yield "Connectors", connectors(controller)
    yield "FMI version", controller.fmi_version
    yield "Made by", controller.generation_tool or "not stated"
    yield "SHA-256", controller.sha256
    yield "Benchmark", f"{head.benchmark}, protocol {head.protocol}"
    yield "Seed", "several" if head.seed is None else str(head.seed)
    yield "Sample time", f"{sample_time.seconds * 1e3:g} ms" + ("" if sample_time.as_in_benchmark else " (own)")
    yield "Plant", f"{plant.file} ({plant.build}), SHA-256 {plant.sha256}"
    yield "Its parameters set", assignments(plant.parameters) or "none"
    yield "Simulations", f"{timing.simulations}, {timing.simulated_time:.0f} simulated seconds"
    yield "Run", f"{timing.start}, {timing.wall_time:.0f} s on {processes}"
    if head.command:
        yield "Command", head.command
    yield "Versions", ", ".join(f"{name} {version}" for name, version in head.environment.items())


class Reason(NamedTuple):
    """Why a requirement is not met, with the ``command`` that repeats its worst case, or is not judged."""

    text: str
    command: str = ""
    advice: str = ""

    def __str__(self) -> str:
        """The whole line."""
        return "; ".join(filter(None, (self.text, self.command and f"repeat with {self.command}", self.advice)))


def reason_text(name: str, passed: bool | None, where: str, why: str) -> str:
    """The verdict on a requirement, where it was found, and why."""
    return f"{' '.join(filter(None, (name, VERDICTS[passed], where)))}: {why}"


def reason_notes(reasons: Iterable[Reason]) -> tuple[Note, ...]:
    """The reasons as lines of a summary."""
    return tuple(Note(str(reason), warning=False) for reason in reasons)


def failure_notes(failed: Sequence[tuple[str, Status, str]], file: str) -> tuple[Note, ...]:
    """The names, statuses and messages of the first cases that ``failed``; ``file`` has the others."""
    notes = [Note(f"{name}: {status.value}: {message}") for name, status, message in failed[:SHOWN_FAILURES]]
    more = (
        [Note(f"... and {len(failed) - SHOWN_FAILURES} more; see {file}.", warning=False)]
        if len(failed) > SHOWN_FAILURES
        else []
    )
    return *notes, *more
