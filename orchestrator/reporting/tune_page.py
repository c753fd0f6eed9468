"""The page ``report.html`` of a tuning: how the search went, which parameters matter, what V costs in stability."""

from __future__ import annotations

from ..codec import plain
from . import pages
from .tuning import Tuning, best_rows, parameter_rows, tuning_remarks
from .wording import assignments, scale


def tune_html(found: Tuning) -> str:
    """The page of what was ``found`` as one HTML file."""
    best, first = found.best, found.trials[0]
    marks = [("target", found.rules.cost.target)]
    if first.cost is not None:
        marks.append(("start", first.cost))
    payload = {name: plain(getattr(found, name)) for name in ("trials", "judged", "importance", "vary", "objective")}
    payload |= {"target": found.rules.cost.target, "best": None if best is None else best.trial.number}
    return pages.render(
        "tune.html",
        pages.TUNE,
        payload,
        found=found,
        cost=None if best is None else best.cost,
        scale=scale(None if best is None else best.cost, marks),
        parameters=parameter_rows(found),
        rows=best_rows(found),
        facts=_facts(found),
        remarks=tuning_remarks(found),
    )


def _facts(found: Tuning) -> list[tuple[str, str]]:
    """How the answer was obtained, as pairs of a name and a text."""
    controller, plant = found.controller, found.plant
    robust = f", and a search of {found.robust} simulations" if found.robust else ""
    return [
        ("Controller", controller.file),
        ("Parameters set", assignments(controller.parameters) or "none"),
        ("SHA-256", controller.sha256),
        ("Benchmark", found.benchmark),
        ("Objective", f"protocol {found.objective}"),
        ("Candidates judged", f"{len(found.judged)}, in the protocol {found.protocol}, seed {found.seed}{robust}"),
        ("Trials", f"{len(found.trials)}, {sum(trial.cut_short for trial in found.trials)} of them cut short"),
        ("Sampler", f"{found.sampler}, seed {found.search_seed}"),
        ("Time", f"{found.wall_time:.0f} s"),
        ("Plant", f"{plant.file} ({plant.build}), SHA-256 {plant.sha256}"),
        ("Its parameters set", assignments(plant.parameters) or "none"),
    ]
