"""The exit code of what was judged, or could not be."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from ..benchmark.certificate import CaseEnding
from ..benchmark.results import CaseResult, Results
from ..benchmark.tally import Tally
from ..loop.trajectory import Status
from ..reporting.certificates import Verification
from ..reporting.robustness import Robustness
from ..reporting.spread import Spread
from .guard import EXIT_INCOMPLETE, EXIT_NOT_JUDGED, EXIT_OK


def results_code(results: Results) -> int:
    """The exit code of an evaluation."""
    return _code(results.cases, (entry.tally for entry in results.stability.values()))


def verification_code(found: Verification) -> int:
    """The exit code of a verification: by the controller's own cases, and by whether its references are judged."""
    own = [score for score in (found, found.strict) if score is not None]
    beside = [score for each in found.references.values() for score in (each, each.strict) if score is not None]
    tallies = (entry.tally for score in (*own, *beside) for entry in score.requirements.values())
    return _code([case for score in own for case in score.cases], tallies)


def shown_code(found: Results | Spread | Robustness) -> int:
    """The exit code of showing again what was found: whether something of it is not judged."""
    if isinstance(found, Results):
        unknown = results_code(found) == EXIT_NOT_JUDGED
    elif isinstance(found, Spread):
        unknown = any(tally.interrupted for score in found.incomplete for tally in score.tallies.values())
    else:
        unknown = any(entry.passed is None for entry in found.requirements.values())
    return EXIT_NOT_JUDGED if unknown else EXIT_OK


def _code(cases: Sequence[CaseResult | CaseEnding], tallies: Iterable[Tally]) -> int:
    if any(case.status is Status.LOST for case in cases) or any(tally.interrupted for tally in tallies):
        return EXIT_NOT_JUDGED
    return EXIT_OK if all(case.simulated for case in cases) else EXIT_INCOMPLETE
