"""From what a process had to say, or left behind, to the run of a case."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass, replace

from msgspec import structs

from ..benchmark.case import Case
from ..benchmark.metrics import case_result
from ..benchmark.results import CaseResult, Judgement
from ..execution.job import Died, Done, Outcome
from ..execution.standstill import Standstill
from ..fmi.trace import CONTROLLER, PLANT, Place
from ..loop.scenario import Scenario
from ..loop.trajectory import Status
from .work import Digested, Simulated

logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class CaseRun:
    """A case with its result, and the wall time [s] it took. ``kind`` is what went wrong without figures, the same for
    equal failures; empty if nothing did."""

    case: Case
    result: CaseResult
    wall_time: float = 0.0
    kind: str = ""


def case_run(case: Case, outcome: Outcome) -> CaseRun:
    """The run of a case from what its process had to say, or left behind."""
    scenario = case.scenario
    if isinstance(outcome, Done):
        value: Judgement | Simulated | Digested = outcome.value
        judgement = value if isinstance(value, Judgement) else value.judgement
        kind = _first_line(judgement.message) if judgement.status is Status.ERROR else ""
        return CaseRun(case, case_result(case, judgement), outcome.wall_time, kind)
    if isinstance(outcome, Died):
        # What somebody else has ended, or kept from ending in time, is no failure of the controller.
        status = Status.LOST if outcome.outside else Status.TIMEOUT if outcome.timeout else Status.CRASHED
        outcome = structs.replace(outcome, place=_plausible(outcome.place, scenario))
        time = float(outcome.place.sample * scenario.sample_time)
        judgement = Judgement(status=status, time=time, message=account(outcome, scenario))
        return CaseRun(case, case_result(case, judgement), outcome.wall_time, outcome.kind)
    error = outcome.error
    kind = f"{error.call} failed" if error.call else _first_line(error.message)
    # Errors are raised before the first sample; a trajectory tells those that come later.
    judgement = Judgement(status=Status.ERROR, time=0.0, message=error.message)
    return CaseRun(case, case_result(case, judgement), outcome.wall_time, kind)


def account(death: Died, scenario: Scenario) -> str:
    """How a process died, where its simulation was, and what it had printed."""
    return "\n  ".join((f"{death.message}, {_whereabouts(death.place, scenario)}", *death.output))


def tell_standstill(standstill: Standstill, name: str, scenario: Scenario | None = None) -> None:
    """Tell that a simulation, or the process called ``name``, stands still: where, and when it is ended."""
    logger.warning("%s", standstill_words(standstill, name, scenario), extra={"what": "standstill"})


def standstill_words(standstill: Standstill, name: str, scenario: Scenario | None) -> str:
    """The same as text; without a ``scenario``, samples tell no time."""
    place = standstill.place if scenario is None else _plausible(standstill.place, scenario)
    end = f"It is ended when {standstill.limit.removesuffix(' was reached')} is reached"
    if math.isfinite(standstill.remaining):
        left = round(standstill.remaining)
        end += f", in about {left} s" if left >= 1 else ", within a second"
    return f"{name} has stood still for {standstill.seconds:.0f} s, {_whereabouts(place, scenario)}. {end}."


def _plausible(place: Place, scenario: Scenario) -> Place:
    """``place`` within what may be simulated: it lay in memory that the FMUs can write into."""
    last = math.ceil(scenario.announced / float(scenario.sample_time))
    return replace(place, sample=min(max(place.sample, 0), last))


def _whereabouts(place: Place, scenario: Scenario | None) -> str:
    who = {PLANT: "the plant", CONTROLLER: "the controller"}.get(place.side)
    if who is None:
        return "outside any FMI call"
    time = "" if scenario is None else f" at t = {float(place.sample * scenario.sample_time):g} s"
    return f"in the call '{place.call}' of {who}{time}"


def _first_line(message: str) -> str:
    return message.split("\n")[0]
