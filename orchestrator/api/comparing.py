"""Several evaluations side by side."""

from __future__ import annotations

from collections.abc import Iterable

from ..reporting.comparison import Group
from ..reporting.comparison import compare as compared
from ..reporting.evaluation import Evaluation
from ..reporting.run import Run


def compare(evaluations: Iterable[Evaluation]) -> tuple[Group, ...]:
    """The evaluations in groups that may be ranked together, the largest group first.

    A group holds those under equal conditions: benchmark version, protocol, rules, seed, sample time and plant. Its
    ``ranked`` entries are in order, those that hold all requirements first, then by V.
    """
    return compared([Run(evaluation.results, evaluation.recordings) for evaluation in evaluations])
