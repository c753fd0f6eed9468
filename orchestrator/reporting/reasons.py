"""Why requirements are not met or not judged, each in one line with what to do: what all outputs say."""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

from ..benchmark.certificate import Score
from ..benchmark.results import Results
from ..benchmark.tally import reason
from .certificates import STRICT, Verification
from .repeat import Setting, again, case_command, setting, simulate_command
from .spread import Spread
from .wording import VERDICTS

VERIFY_AGAIN = "to run it again, verify again"


class Reason(NamedTuple):
    """Why a requirement is not met, with the ``command`` that repeats its worst case, or is not judged."""

    text: str
    command: str = ""
    advice: str = ""

    def __str__(self) -> str:
        """The whole line."""
        return "; ".join(filter(None, (self.text, self.command and f"repeat with {self.command}", self.advice)))


def reasons(results: Results) -> Iterator[Reason]:
    """The requirements of an evaluation."""
    for name, entry in results.stability.items():
        if not entry.passed:
            text = _text(name, entry.passed, "", entry.reason)
            command = simulate_command(results, entry.tally.first) if entry.tally.failed else ""
            yield Reason(text, command, "" if command else again(entry.tally))


def spread_reasons(spread: Spread) -> Iterator[Reason]:
    """The requirements over several seeds, of the first seed with which one is not met or not judged."""
    scores, of = (*spread.seeds, *spread.incomplete), len(spread.seeds) + len(spread.unfinished)
    for name in spread.requirements:
        passed, worst = spread.passed(name), spread.worst(name)
        if worst is None or name not in worst.tallies:  # files of older versions have no tallies
            continue
        alike = sum(score.requirements[name] is passed for score in scores)
        where = f"with {alike} of {of} seeds ({'first ' if alike > 1 else ''}seed {worst.seed})"
        tally = worst.tallies[name]
        command = case_command(setting(spread, worst.seed), tally.first) if tally.failed else ""
        yield Reason(_text(name, passed, where, reason(tally)), command, "" if command else again(tally))


def verification_reasons(found: Verification) -> Iterator[Reason]:
    """The requirements of the controller over the draws and on the list of worst cases, and those of a reference that
    are not judged."""
    yield from _own(found, found, found.protocol, f"in {{}} of {len(found.draws)} draws")
    if found.strict is not None:
        yield from _own(found, found.strict, STRICT, "on the worst poses")
    for name, reference in found.references.items():
        for where, score in (("over the draws", reference), ("on the worst poses", reference.strict)):
            for each, entry in score.requirements.items() if score is not None else ():
                if entry.tally.interrupted:
                    text = _text(f"{name}: {each}", entry.passed, where, entry.reason)
                    yield Reason(text, advice=VERIFY_AGAIN)


def _own(found: Verification, score: Verification | Score, protocol: str, where: str) -> Iterator[Reason]:
    for name, entry in score.requirements.items():
        if entry.passed is False and entry.worst_case is not None:
            own = Setting(found.controller, found.plant, protocol, entry.worst_case.seed, found.sample_time)
            text = _text(name, False, where.format(entry.failed_draws), entry.reason)
            yield Reason(text, case_command(own, entry.worst_case.id))
        elif not entry.passed:
            place = "" if "{" in where else where
            advice = VERIFY_AGAIN if entry.tally.interrupted else ""
            yield Reason(_text(name, entry.passed, place, entry.reason), advice=advice)


def _text(name: str, passed: bool | None, where: str, why: str) -> str:
    return f"{' '.join(filter(None, (name, VERDICTS[passed], where)))}: {why}"
