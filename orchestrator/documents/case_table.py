"""Cases as tables: those of a protocol and of a run in a notebook, all of a run as CSV, and Parquet for pandas or a
database."""

from __future__ import annotations

from collections import Counter
from typing import Any

from ..benchmark.case import Case
from ..benchmark.results import CaseResult
from ..views.export import csv_text
from ..views.table import Column, Summary, Table, VerdictCell
from ..views.units import SECOND
from .document import Displayable
from .results import Results

# Imports inside functions: pyarrow is optional.


LISTED = 12
"""Cases that a notebook shows; the others are counted."""


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


class Cases(tuple[CaseResult, ...], Displayable):
    """Cases in the protocol's order; shows itself in a notebook."""

    __slots__ = ()

    def summary(self) -> Summary:
        """The first cases, and how all ended."""
        rows = tuple(
            (case.id, VerdictCell(case.simulated if case.judged else None, case.status.value), case.time, case.message)
            for case in self[:LISTED]
        )
        counts = ", ".join(f"{count} {status}" for status, count in Counter(c.status.value for c in self).items())
        columns = (Column("case"), Column("status"), Column("time", SECOND), Column("message"))
        more = f"{LISTED} of {len(self)} cases" if len(self) > LISTED else ""
        return Summary(f"{len(self)} cases", counts, (Table("Cases", columns, rows, caption=more),))

    def __repr__(self) -> str:
        return f"Cases({self.summary().title}: {self.summary().kicker})"


def case_table(results: Results) -> dict[str, list[Any]]:
    """One list per column, one element per case; names carry the SI unit. None if a case has no such figure."""
    cases = results.cases

    def measured(name: str) -> list[Any]:
        return [getattr(case.measurements, name) for case in cases]

    return {
        "id": [case.id for case in cases],
        "status": [case.status.value for case in cases],
        "configuration": [case.configuration.index for case in cases],
        "q_a1 [rad]": [case.configuration.q_a1 for case in cases],
        "q_a2 [rad]": [case.configuration.q_a2 for case in cases],
        "system": [case.system for case in cases],
        "test": [case.test for case in cases],
        "time [s]": [case.time for case in cases],
        **{f"{name} [{criterion.unit}]": measured(name) for name, criterion in results.criteria.items()},
        "settled": measured("settled"),
        **{f"{name} [m]": measured(name) for name in ("limit_cycle_x", "limit_cycle_z", "rest_error")},
        "limit_cycle_ratio": measured("limit_cycle_ratio"),
        "limit_cycle_frequency [Hz]": measured("limit_cycle_frequency"),
        "recovery [s]": measured("recovery"),
        "warnings": [case.warnings for case in cases],
        "message": [case.message for case in cases],
    }


def cases_csv(results: Results) -> str:
    """The contents of ``cases.csv``, one row per case."""
    table = case_table(results)
    return csv_text(table, zip(*table.values(), strict=True))


def parquet_bytes(results: Results) -> bytes:
    """The same table in Parquet, by the optional package pyarrow."""
    from pyarrow import BufferOutputStream, bool_, float64, parquet, table

    columns = table(case_table(results))
    for number, name in enumerate(columns.column_names):
        if columns.schema.field(name).type == "null":  # no case has such a figure
            kind = bool_() if name == "settled" else float64()
            columns = columns.set_column(number, name, columns.column(name).cast(kind))
    sink = BufferOutputStream()
    parquet.write_table(columns, sink)
    contents: bytes = sink.getvalue().to_pybytes()
    return contents
