"""Results as a piece of HTML, for notebooks: escaped, without scripts, and in the notebook's own style."""

from __future__ import annotations

import base64
from collections.abc import Mapping, Sequence

from ..benchmark.linearization import Mode
from ..benchmark.results import CaseResult, Results
from ..loop.trajectory import Ending
from . import pages
from .reasons import reasons, spread_reasons
from .robustness import (
    Robustness,
    largest_words,
    margin_words,
    radius_rows,
    robustness_remarks,
    verdict_words,
)
from .spread import Spread, spread_remarks, statistic_rows
from .sweep import COLUMNS, Sweep, smallest_words, sweep_rows
from .tuning import Tuning, best_rows, best_words, parameter_rows, tuning_remarks
from .wording import SHOWN, figure, number, remarks, requirement_rows

UNITS = dict.fromkeys(("B1", "B2", "B3", "B4"), "N.m") | {"B5": "m", "B6": "s", "B7": "m", "recovery": "s"}
UNITS |= dict.fromkeys(("limit_cycle", "rest_error"), "m")
"""Units of :class:`~orchestrator.benchmark.results.Measurements`."""


def results_fragment(results: Results) -> str:
    """The scorecard and the verdicts as two small tables, with V above and what a reader must know below."""
    rows = [
        (name, score.title, SHOWN[score.unit][1], *(figure(score, v) for v in (score.value, score.target, score.paper)))
        for name, score in results.criteria.items()
    ]
    return pages.filled(
        "results_fragment.html",
        results=results,
        criteria=rows,
        requirements=requirement_rows(results),
        reasons=list(reasons(results)),
        remarks=remarks(results),
    )


def spread_fragment(spread: Spread) -> str:
    """Mean, standard deviation and range of V and the criteria, and for how many seeds the requirements hold."""
    return pages.filled(
        "spread_fragment.html",
        spread=spread,
        rows=statistic_rows(spread),
        reasons=list(spread_reasons(spread)),
        remarks=spread_remarks(spread),
    )


def robustness_fragment(found: Robustness) -> str:
    """The largest values found, the requirements, margins and radius."""
    rows = [(f"largest {name}", largest_words(entry)) for name, entry in found.criteria.items()]
    rows += [(name, verdict_words(entry)) for name, entry in found.requirements.items()]
    rows += [(name, margin_words(name, margin)) for name, margin in found.margins.items()]
    rows += radius_rows(found.radius)
    return pages.filled("robustness_fragment.html", found=found, rows=rows, remarks=robustness_remarks(found))


def tuning_fragment(found: Tuning) -> str:
    """The parameters found, and where V of them was measured."""
    return pages.filled(
        "tuning_fragment.html",
        found=found,
        best=best_words(found),
        parameters=parameter_rows(found),
        rows=best_rows(found),
        remarks=tuning_remarks(found),
    )


def sweep_fragment(found: Sweep) -> str:
    """The combinations, and the best of them."""
    names, rows = (*found.values, *COLUMNS), sweep_rows(found)
    return pages.filled("sweep_fragment.html", found=found, best=smallest_words(found), names=names, rows=rows)


def simulation_fragment(title: str, ending: Ending, result: CaseResult, figure_svg: str) -> str:
    """How a simulation ended, what was measured, and its plot."""
    found = [(name, getattr(result.measurements, name), unit) for name, unit in UNITS.items()]
    return pages.filled(
        "simulation_fragment.html",
        title=title,
        ending=ending,
        measured=[
            (name, number(value, SHOWN[unit][0]), SHOWN[unit][1]) for name, value, unit in found if value is not None
        ],
        # An image cannot run what a script in it says.
        image="data:image/svg+xml;base64," + base64.b64encode(figure_svg.encode()).decode("ascii"),
    )


def linear_fragment(title: str, at: Mapping[str, Sequence[float]], modes: Sequence[Mode]) -> str:
    """Where a model is linearized, and frequencies and damping of its motions."""
    units = {"q_a": "rad", "q_m": "rad", "u_m": "N.m", "X": "m"}
    rest = [(f"{name} [{units[name]}]", pair) for name, pair in at.items()]
    return pages.filled("linear_fragment.html", title=title, at=rest, modes=modes)
