"""The cases of a protocol as a notebook shows them: how many there are of each test, not every number of each."""

from __future__ import annotations

from collections import Counter

from ..benchmark.case import Case
from ..views.table import Column, Summary, Table
from .document import Displayable


class CaseList(tuple[Case, ...], Displayable):
    """Cases in the order of their protocol; a tuple that shows itself in a notebook."""

    def summary(self) -> Summary:
        """The tests, and how many cases there are of each."""
        counts = Counter(case.test.name for case in self)
        systems = {name: {case.system.name for case in self if case.test.name == name} for name in counts}
        rows = tuple((name, count, len(systems[name])) for name, count in counts.items())
        columns = (Column("test"), Column("cases"), Column("systems"))
        poses = len({case.configuration for case in self})
        return Summary("Cases", f"{len(self)} cases at {poses} poses", (Table("Tests", columns, rows),))

    def __repr__(self) -> str:
        return f"CaseList({len(self)} cases, {self[0].id} to {self[-1].id})" if self else "CaseList(no cases)"
