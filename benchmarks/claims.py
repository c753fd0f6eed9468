"""What is known of the project's controllers beyond the searches of the leaderboard: the claims in docs/claims.json.

A search gives bounds, and whoever finds a worse case moves them. A claim is one such case: a larger V or criterion, a
smaller margin, a requirement that fails. Each row of the leaderboard has the worst of the own search and of all claims,
so that a new run of benchmarks/leaderboard.py loses none. ``python benchmarks/counterexamples.py`` repeats those that
have a command.
"""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from orchestrator.benchmark.results import Kind  # noqa: E402
from orchestrator.codec import NonNegative, Struct, from_json, to_json  # noqa: E402

CLAIMS = ROOT / "docs" / "claims.json"

OWN = "this project"
"""What ``by`` begins with of a claim by the project itself, which is no independent attack."""

MARGINS = ("gain", "delay")
"""What the names of margins begin with."""

TAKEN = ("value", "command", "kind", "limit_cycle", "frequency", "rest_error", "seeds_failed", "seeds_tried")
"""What the tables take from a claim."""

Figures = Mapping[str, Any]
"""What docs/leaderboard.json has of a controller."""


class Claim(Struct):
    """A figure of a controller that somebody found.

    Parameters
    ----------
    controller : str
        Name of its FMU.
    cases : str
        Hash of the controller's cases on ``paper``, as in docs/leaderboard.json: a claim is about a controller as it
        was, and another version has other cases.
    figure : str
        ``"V"``; ``"B5"`` to ``"B7"``, the largest value of all; ``"A1"`` to ``"A3"``, which fails; or a margin, such as
        ``"delay_1"``.
    value : float, optional
        In SI units; none for a requirement.
    by, date : str
        Who found it, and when.
    command : str
        What repeats it. It is empty if the arms were not published.
    means : dict
        For V, the means of B5 to B7 over the configurations, as far as they are known [SI].
    kind, limit_cycle, frequency, rest_error, seeds_failed, seeds_tried
        What the command gives, and with how many realizations of the noise, for a requirement and for a margin.
    """

    controller: str
    cases: str
    figure: str
    by: str
    date: str
    value: NonNegative | None = None
    command: str = ""
    means: dict[str, NonNegative] = {}
    kind: Kind = "no verdict"
    limit_cycle: NonNegative | None = None
    frequency: NonNegative | None = None
    rest_error: NonNegative | None = None
    seeds_failed: int = 0
    seeds_tried: int = 0


def claims() -> tuple[Claim, ...]:
    """All that are kept."""
    return from_json(CLAIMS.read_bytes(), tuple[Claim, ...])


def add(new: Sequence[Claim]) -> None:
    """Keep further claims."""
    kept = json.loads(CLAIMS.read_text(encoding="utf-8"))
    kept += [json.loads(to_json(claim)) for claim in new]
    CLAIMS.write_text(json.dumps(kept, indent=1) + "\n", encoding="utf-8")


def counting(figures: Figures, others: Sequence[Claim]) -> dict[str, Claim]:
    """The claims about a controller that go beyond its own search, of each figure the worst."""
    about = sorted((claim for claim in others if claim.controller == name_of(figures)), key=_severity)
    return {claim.figure: claim for claim in about if _goes_beyond(claim, figures["robustness"])}


def attacks(figures: Figures, others: Sequence[Claim]) -> int:
    """The number of attacks on a controller by others, each with a claim at least, also one that finds nothing worse
    than the own search."""
    about = (claim.by for claim in others if claim.controller == name_of(figures))
    return len({by for by in about if not by.startswith(OWN)})


def known(figures: Figures, others: Sequence[Claim]) -> Figures:
    """The ``figures`` of a controller with the worst of its own search, whose V is ``own_cost``, and of the claims: V,
    B5 to B7, requirements, margins, the number of ``attacks`` by others, and radii of at most 1 (``at_most``) where an
    arm within the tolerances misses the target of V or fails a requirement."""
    search, worse = figures["robustness"], counting(figures, others)
    cost: float = (worse["V"].value if "V" in worse else None) or search["cost"]
    requirements = _replaced(search["requirements"], worse)
    missed = {"cost": cost > 100.0, "stability": any(entry["passed"] is False for entry in requirements.values())}
    at_most = [part for part, missing in missed.items() if missing and _or_infinite(search["radius"][part]) > 1.0]
    found = {
        "cost": cost,
        "own_cost": search["cost"],
        "attacks": attacks(figures, others),
        "requirements": requirements,
        "worst_case": _replaced(search["worst_case"], worse),
        "margins": _replaced(search["margins"], worse),
        "radius": {**search["radius"], **dict.fromkeys(at_most, 1.0), "at_most": at_most},
    }
    return {**figures, "robustness": {**search, **found}}


def best_known(kept: Sequence[Figures]) -> list[Figures]:
    """What is :func:`known` of all controllers, by the claims that are kept."""
    return [known(figures, claims()) for figures in kept]


def name_of(figures: Figures) -> str:
    """The name of the controller's FMU."""
    return Path(figures["controller"]["file"]).stem


def _severity(claim: Claim) -> tuple[float, bool]:
    """What claims of one figure are sorted by, so that the worst comes last: of a margin it is the smallest, and of
    equal ones that which can be repeated."""
    value = claim.value or 0.0
    return -value if claim.figure.startswith(MARGINS) else value, bool(claim.command)


def _goes_beyond(claim: Claim, search: Mapping[str, Any]) -> bool:
    if claim.figure in search["requirements"]:
        return search["requirements"][claim.figure]["passed"] is not False
    assert claim.value is not None, f"a claim about {claim.figure} needs a value"
    if claim.figure.startswith(MARGINS):
        return claim.value < _or_infinite(search["margins"][claim.figure]["value"])
    own: float = search["cost"] if claim.figure == "V" else search["worst_case"][claim.figure]["value"]
    return claim.value > own


def _or_infinite(value: float | None) -> float:
    """A margin or a radius; none was found where it is None."""
    return math.inf if value is None else value


def _replaced(entries: Mapping[str, Mapping[str, Any]], worse: Mapping[str, Claim]) -> dict[str, Mapping[str, Any]]:
    """What a search has by figure, with what a claim says in its place."""
    return {
        key: {**entry, "passed": False, **{name: getattr(worse[key], name) for name in TAKEN}}
        if key in worse
        else entry
        for key, entry in entries.items()
    }
