"""Candidates of a tuning or a sweep, tried side by side."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from ..benchmark.case import Case
from ..benchmark.protocol import Protocol
from ..benchmark.results import CaseResult, Rules
from ..errors import InputError
from ..fmi.variables import variables
from ..pairing.controller import Controller
from ..pairing.pairing import Pairing
from ..search.candidates import Trial, measured, trial
from .requests import Requests, side_by_side


def attempt(
    protocol: Protocol,
    own: Rules,
    pairings: Sequence[Pairing],
    cases: Sequence[Case],
    asked: Sequence[tuple[int, dict[str, float]]],
    worst: float = math.inf,
) -> Requests[list[Trial]]:
    """Trials of numbered candidates, each with its pairing, in ``cases``, judged by the rules; those whose V alone
    exceeds ``worst`` are cut short."""
    performance, requirements = measured(cases)
    results: list[list[CaseResult]] = [[] for _ in asked]
    found = [Trial(number, values, 0.0) for number, values in asked]
    alive = list(range(len(asked)))
    for stage in (performance, requirements):
        runs = yield side_by_side(protocol, [(pairings[place], stage) for place in alive])
        for place, new in zip(alive, runs, strict=True):
            results[place] += [run.result for run in new]
            found[place] = trial(own, *asked[place], results[place], whole=stage is requirements)
        alive = [place for place in alive if not found[place].message and found[place].objective <= worst]
    return found


def values_of(controller: Controller, wanted: Iterable[str]) -> dict[str, float]:
    """The parameters of a controller that are numbers, by FMI name: the FMU's own values, or as they are set.

    Raises :class:`InputError` if one that is ``wanted`` is not among them.
    """
    known = variables(controller.archive.description).values()
    own = {each.name: each.start[0] for each in known if each.causality == "parameter" and len(each.start) == 1}
    values = {**own, **controller.setup.parameters}
    found = {name: float(value) for name, value in values.items() if not isinstance(value, bool | str)}
    if unknown := sorted(set(wanted) - found.keys()):
        message = f"{controller.name} has no parameter {unknown[0]}. It has: {', '.join(found) or 'none'}."
        raise InputError(message, "no-parameter", controller.name, unknown[0], tuple(found))
    return found
