"""What is shown of a search for the worst case: its tables, and the tabs of its page ``report.html``."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from ..benchmark.results import Rules
from ..loop.trajectory import Status
from ..search.findings import CriterionSearched, Margin, Radius, RequirementSearched
from ..views.table import (
    Cell,
    Column,
    Headline,
    Link,
    Quantity,
    Table,
    Value,
    VerdictCell,
)
from ..views.units import MILLISECOND, NONE, SHOWN, amplitude, number
from .head import Head
from .recording import BESIDE, Recording
from .wording import REQUIREMENTS, head_facts

NO_PROOF = (
    "Each failure comes with a command that reproduces it. If the search finds no failure, the controller may still "
    "have one."
)
VALUE = (
    "Value: the mean over the configurations of the largest value found at each, as in Table 2 of the paper. Largest: "
    "of all. Both are lower bounds."
)


def headline(
    cost: float | None, listed: float | None, protocol: str, target: float, left_out: Sequence[str]
) -> Headline:
    """What the search made of V; ``left_out`` are criteria that were not searched for."""
    marks = [("target", target)] + ([] if listed is None else [("list", listed)])
    sentence = (
        f"V from the largest values found, a lower bound of the true one; {number(listed)} on the list of the protocol "
        f"{protocol}, with which the search began."
    )
    if cost is None and left_out:
        sentence = f"No V: it needs all criteria, and {', '.join(left_out)} were not searched for."
    elif cost is None:
        sentence = "No V: a case that counts has no value."
    elif listed is None:
        sentence = "The search began without a list: V has values of few configurations."
    return Headline("Cost V", cost, tuple(marks), sentence)


def facts(
    head: Head, simulations: int, spent: float, budget: int, starts: Sequence[float | None]
) -> Iterator[tuple[str, str]]:
    """How the answer was obtained."""
    yield from head_facts(head)
    yield "Budget", f"{spent:.0f} of {budget} whole cases, in {simulations} simulations"
    if len(starts) > 1:
        yield "V found by each start", ", ".join(map(number, starts))


def largest(
    rules: Rules,
    criteria: Mapping[str, CriterionSearched],
    cost: float | None,
    listed: float | None,
    shown: Mapping[str, int],
) -> Table:
    """The largest values of the criteria, beside those of the protocol's list and the targets."""
    columns = (Column(""), Column("value"), Column("of the list"), Column("target"), Column("largest"), Column("case"))
    rows: list[tuple[Cell, ...]] = []
    for name, entry in criteria.items():
        unit, worst = SHOWN[entry.unit], entry.worst_case
        most: Cell = "unstable" if worst.value is None and worst.command else Value(worst.value, unit=unit)
        words = "show" if name in shown else "command" if worst.command else "-"
        values = (Value(value, unit=unit) for value in (entry.value, entry.protocol, rules.criteria[name].target))
        rows.append((Quantity(name, unit), *values, most, Link(words, worst.command, shown.get(name))))
    total = ("V", Value(cost), Value(listed), rules.cost.target, None, None)
    return Table("Largest values found", columns, tuple(rows), (total,), VALUE)


def requirements(rules: Rules, searched: Mapping[str, RequirementSearched], shown: Mapping[str, int]) -> Table:
    """What the requirements came to."""
    rows: list[tuple[Cell, ...]] = []
    for name, entry in searched.items():
        tests = [test for test in rules.tests if name in test.requirements and not test.repeats]
        title = REQUIREMENTS[name].format(gain=tests[0].gain, delay=tests[0].delay * 1e3, axis="1 or 2")
        words = "fails" if entry.passed is False else "no failure found" if entry.passed else "not judged"
        rows.append(
            (name, title, VerdictCell(entry.passed, words), Link(ending(entry), entry.command, shown.get(name)))
        )
    columns = (Column(""), Column("requirement", minor=True), Column("found"), Column("worst case"))
    return Table("Requirements", columns, tuple(rows), caption=NO_PROOF)


def ending(requirement: RequirementSearched) -> str:
    """What the worst case of a requirement came to."""
    if requirement.passed:
        return f"nearest: {requirement.kind}, {amplitude(requirement.limit_cycle)}"
    if requirement.passed is None:
        return "simulations were skipped or lost"
    if requirement.status not in (Status.DONE, Status.UNSTABLE):
        return f"a simulation ended with {requirement.status.value}"
    cycle = (
        f", {amplitude(requirement.limit_cycle)} at {number(requirement.frequency)} Hz"
        if requirement.limit_cycle
        else ""
    )
    return f"{requirement.kind}{cycle}, with {requirement.seeds_failed} of {requirement.seeds_tried} seeds"


def margin_value(name: str, margin: Margin) -> Value:
    """A margin, what it is at most, or the limit that none was found up to: a factor, or a delay shown in
    milliseconds."""
    unit, down = MILLISECOND if name.startswith("delay") else NONE, name.endswith("down")
    if margin.value is None:
        return Value(margin.limit, unit=unit, beyond="<" if down else ">")
    return Value(margin.value, unit=unit, beyond="" if margin.refined else "≥" if down else "≤")


def radius_values(radius: Radius | None) -> dict[str, Value]:
    """The two factors on the tolerances of Table 1 by name; none if there is no radius."""
    if radius is None:
        return {}
    factors = {
        "radius of V": (radius.cost, radius.cost_refined),
        "radius of A1-A3": (radius.stability, radius.stability_refined),
    }
    return {
        name: Value(radius.limit, beyond=">") if at is None else Value(at, beyond="" if refined else "≤")
        for name, (at, refined) in factors.items()
    }


def margin_table(rules: Rules, margins: Mapping[str, Margin], radius: Radius | None) -> Table:
    """Margins and radius, beside what A1 and A2 ask for."""
    gain, delay = (max(getattr(test, name) for test in rules.tests) for name in ("gain", "delay"))
    rows: list[tuple[Cell, ...]] = []
    for name, margin in margins.items():
        value = margin_value(name, margin)
        asked = None if name.endswith("down") else Value(delay if name.startswith("delay") else gain, unit=value.unit)
        seeds = "" if margin.value is None else f"{margin.seeds_failed} of {margin.seeds_tried}"
        rows.append((Quantity(name, value.unit or NONE), value, asked, Link(seeds, margin.command)))
    rows += [(name, value, 1.0, "") for name, value in radius_values(radius).items()]
    columns = (Column(""), Column("fails at"), Column("asked for"), Column("fails with seeds"))
    caption = (
        "The smallest factor of the loop gain and additional delay of one axis, and the factors on the tolerances of "
        "Table 1, that were found to make the loop fail: upper bounds of the true ones."
    )
    if any(isinstance(cell, Value) and cell.beyond in ("≤", "≥") for row in rows for cell in row):
        caption += " ≤, ≥: the budget did not last to try what fails there with less."
    return Table("Margins and radius", columns, tuple(rows), caption=caption)


def commands(
    criteria: Mapping[str, CriterionSearched],
    requirements: Mapping[str, RequirementSearched],
    margins: Mapping[str, Margin],
) -> Iterator[tuple[str, str]]:
    """Commands by what they repeat: failures first, then margins, then the largest values. A case that is the worst in
    several respects has one command."""
    pairs = [
        (f"{name} fails", requirement.command)
        for name, requirement in requirements.items()
        if requirement.passed is False
    ]
    pairs += [(f"margin {name}", margin.command) for name, margin in margins.items()]
    pairs += [(f"largest {name}", entry.worst_case.command) for name, entry in criteria.items()]
    named: dict[str, list[str]] = {}
    for name, command in pairs:
        if command:
            named.setdefault(command, []).append(name)
    for command, names in named.items():
        yield ", ".join(names), command


def cases(recordings: Sequence[Recording]) -> list[tuple[Recording, Recording | None]]:
    """The recordings of the worst cases, each with that of the nominal arm in the same pose and test."""
    beside = {role: entry for entry in recordings for role in entry.about.roles if role.startswith(BESIDE)}
    worst = (entry for entry in recordings if not set(entry.about.roles) & set(beside))
    return [(entry, beside.get(f"{BESIDE} {entry.about.roles[0]}")) for entry in worst]
