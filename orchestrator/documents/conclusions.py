"""What the sentences are made of that reports begin with: the verdict, its reason, and what costs most."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from ..benchmark.results import Rules
from ..views.table import VERDICTS, Conclusion, Link

ALL = ("A1", "A2", "A3")
"""The requirements of the paper."""


def conclusion(passed: bool | None, words: Sequence[str], steps: Sequence[Link]) -> Conclusion:
    """One sentence of clauses; those that are empty are left out."""
    return Conclusion("; ".join(filter(None, words)) + ".", passed, tuple(steps))


def overall(passed: Mapping[str, bool | None]) -> bool | None:
    """The verdict on all requirements together; None as well where there is none."""
    if False in passed.values():
        return False
    return None if None in passed.values() or not passed else True


def decisive(passed: Mapping[str, bool | None]) -> tuple[str, ...]:
    """The requirements that the verdict on all rests on: those that are not met, else those not judged, else all."""
    verdict = overall(passed)
    return tuple(name for name, one in passed.items() if one is verdict)


def verdict_words(passed: Mapping[str, bool | None]) -> str:
    """The verdict on the requirements, such as ``A2 and A3 are not met``; empty where there is none."""
    names = decisive(passed)
    return f"{listed(names)} {'is' if len(names) == 1 else 'are'} {VERDICTS[overall(passed)]}" if names else ""


def listed(names: Sequence[str]) -> str:
    """Names in a sentence."""
    if tuple(names) == ALL:
        return f"{ALL[0]} to {ALL[-1]}"
    *most, last = names
    return f"{', '.join(most)} and {last}" if most else last


def cost_words(words: str, marks: Mapping[str, float | None]) -> str:
    """V in ``words`` beside the values that it is measured by, as far as there are some."""
    beside = ", ".join(f"{name} {mark:.4g}" for name, mark in marks.items() if mark is not None)
    return f"{words} ({beside})" if beside else words


def costliest(rules: Rules, values: Mapping[str, float | None]) -> tuple[str, float] | None:
    """The criterion with the largest share of V, and its share, from 0 to 1; None unless all ``values`` [SI units] of
    the criteria are there."""
    shares: dict[str, float] = {}
    for name, spec in rules.criteria.items():
        if (value := values.get(name)) is None:
            return None
        shares[name] = spec.weight * value / spec.target
    total = sum(shares.values())
    if not total:
        return None
    name = max(shares, key=lambda one: shares[one])
    return name, shares[name] / total


def share_words(rules: Rules, values: Mapping[str, float | None]) -> str:
    """What costs most, such as ``of which B7 (chirp error) costs most, 47 %``; empty if that is not known."""
    largest = costliest(rules, values)
    if largest is None:
        return ""
    name, share = largest
    return f"of which {name} ({rules.criteria[name].title.lower()}) costs most, {100.0 * share:.0f} %"
