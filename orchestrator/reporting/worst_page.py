"""The page ``report.html`` of a search for the worst case: what was found, how, and how far the controller holds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ..codec import plain
from . import pages
from .payload import criteria, packed, packed_error
from .recording import BESIDE, MOTION_INTERVALS, Recording
from .robustness import Robustness, robustness_remarks, verdict_words
from .wording import REQUIREMENTS, assignments, parameter_words, scale


def worst_html(found: Robustness, recordings: Sequence[Recording] = ()) -> str:
    """The page of what was ``found`` as one HTML file, with the ``recordings`` of the worst cases."""
    payload = worst_payload(found, recordings)
    shown = {role: number for number, entry in enumerate(payload["recordings"]) for role in entry["roles"]}
    marks = [("target", found.rules.cost.target)]
    if found.protocol_cost is not None:
        marks.append(("list", found.protocol_cost))
    return pages.render(
        "worst.html",
        pages.WORST,
        payload,
        found=found,
        scale=scale(found.cost, marks),
        sentence=_sentence(found),
        criteria=payload["criteria"],
        requirements=list(_requirements(found)),
        shown={role.split(" ")[0]: number for role, number in shown.items()},
        commands=dict(_commands(found)),
        facts=_facts(found),
        remarks=robustness_remarks(found),
    )


def worst_payload(found: Robustness, recordings: Sequence[Recording]) -> dict[str, Any]:
    """Everything the page's figures show."""
    specs = {name: spec for name, spec in found.rules.criteria.items() if name in found.criteria}
    beside = {role: entry for entry in recordings for role in entry.about.roles if role.startswith(BESIDE)}
    worst = [entry for entry in recordings if not set(entry.about.roles) & set(beside)]
    commands = {name: entry.worst_case.command for name, entry in found.criteria.items()}
    commands |= {name: entry.command for name, entry in found.requirements.items()}
    packs = []
    for entry in worst:
        role = entry.about.roles[0]
        nominal = beside.get(f"{BESIDE} {role}")
        packs.append(
            {
                **packed(entry, commands[role.split(" ")[0]]),
                "beside": None if nominal is None else packed_error(nominal, MOTION_INTERVALS),
            }
        )
    return {
        "criteria": [{**spec, **plain(found.criteria[spec["name"]])} for spec in criteria(specs)],
        "rules": plain(found.rules),
        "path": plain(found.path),
        "effects": [{**plain(effect), "words": parameter_words(effect.parameter)} for effect in found.effects],
        "configurations": plain(found.configurations),
        "margins": plain(found.margins),
        "radius": plain(found.radius),
        "recordings": packs,
    }


def _sentence(found: Robustness) -> str:
    """What the search made of V."""
    if found.cost is None:
        return "No cost: a case that counts has no value."
    if found.protocol_cost is None:
        return "The search began without a list: V has values of few configurations."
    return (
        f"V from the largest values found, a lower bound of the true one; {found.protocol_cost:.1f} on the list of the "
        f"protocol {found.protocol}, with which the search began."
    )


def _requirements(found: Robustness) -> Iterator[dict[str, Any]]:
    for name, entry in found.requirements.items():
        tests = [test for test in found.rules.tests if name in test.requirements and not test.repeats]
        title = REQUIREMENTS[name].format(gain=tests[0].gain, delay=tests[0].delay * 1e3, axis="1 or 2")
        words = verdict_words(entry).removeprefix("fails: ").removeprefix("no failure found; ")
        words = words.removeprefix("not judged: ")
        yield {"name": name, "title": title, "passed": entry.passed, "words": words}


def _commands(found: Robustness) -> Iterator[tuple[str, str]]:
    """Commands by what they repeat: failures first, then margins, then the largest values."""
    for name, requirement in found.requirements.items():
        if requirement.passed is False:
            yield f"{name} fails", requirement.command
    for name, margin in found.margins.items():
        if margin.command:
            yield f"margin {name}", margin.command
    for name, requirement in found.requirements.items():
        if requirement.passed:
            yield f"{name}, nearest to failing", requirement.command
    for name, entry in found.criteria.items():
        if entry.worst_case.command:
            yield f"largest {name}", entry.worst_case.command


def _facts(found: Robustness) -> list[tuple[str, str]]:
    """How the answer was obtained, as pairs of a name and a text."""
    controller, plant = found.controller, found.plant
    return [
        ("Controller", controller.file),
        ("Parameters set", assignments(controller.parameters) or "none"),
        ("SHA-256", controller.sha256),
        ("Benchmark", f"{found.benchmark}, protocol {found.protocol}"),
        ("Seed", str(found.seed)),
        ("Simulations", f"{found.simulations}, budget {found.budget}"),
        ("Time", f"{found.wall_time:.0f} s"),
        ("Plant", f"{plant.file} ({plant.build}), SHA-256 {plant.sha256}"),
        ("Its parameters set", assignments(plant.parameters) or "none"),
    ]
