"""What a check finds out about a controller, as a user holds it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import overload

from ..conformance.finding import Finding, Severity
from ..views.table import Column, Summary, Table, VerdictCell
from .document import Displayable

PASSED = {Severity.OK: True, Severity.NOTE: True, Severity.WARNING: None, Severity.ERROR: False}


@dataclass(frozen=True)
class Findings(Displayable, Sequence[Finding]):
    """The findings on a ``controller``, in the order of the checks; shows itself in a notebook."""

    controller: str
    found: tuple[Finding, ...]

    def __len__(self) -> int:
        return len(self.found)

    @overload
    def __getitem__(self, place: int) -> Finding: ...

    @overload
    def __getitem__(self, place: slice) -> tuple[Finding, ...]: ...

    def __getitem__(self, place: int | slice) -> Finding | tuple[Finding, ...]:
        return self.found[place]

    @property
    def worst(self) -> Severity:
        """The severity of the worst finding."""
        return max((finding.severity for finding in self.found), key=list(Severity).index, default=Severity.OK)

    def advised(self, finding: Finding, remedy: str) -> Findings:
        """The findings with one more ``remedy`` for one of them."""
        more = replace(finding, remedy=" ".join(filter(None, (finding.remedy, remedy))))
        return replace(self, found=tuple(more if other is finding else other for other in self.found))

    def summary(self) -> Summary:
        """A row for each finding."""
        rows = tuple(
            (
                VerdictCell(PASSED[finding.severity], finding.severity.value),
                finding.subject,
                "\n".join(filter(None, (finding.text, finding.remedy))),
            )
            for finding in self.found
        )
        columns = (Column(""), Column("subject"), Column("finding"))
        return Summary(self.controller, f"verdict: {self.worst.value}", (Table("Findings", columns, rows),))
