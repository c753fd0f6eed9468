"""Several results side by side."""

from __future__ import annotations

from collections.abc import Iterable

from ..documents.comparison import Comparison
from ..documents.comparison import compare as compared
from ..documents.document import Comparable
from ..entry import results


def compare(documents: Iterable[Comparable]) -> Comparison:
    """Evaluations, and other results of the benchmark, in groups that may be ranked together.

    A group holds those of one kind under equal conditions: benchmark version, protocol, rules, seed, sample time and
    plant; of each kind the largest group comes first. Its ``ranked`` entries are in order, those that meet all
    requirements first, then by V. Raises :class:`InputError` for what is no result.
    """
    entered = results("documents", documents)
    return compared([(document, getattr(document, "folder", None)) for document in entered])
