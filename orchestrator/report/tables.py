"""All cases of a run as one table: CSV, and Parquet for those who go on in pandas or a database."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from typing import Any

Document = Mapping[str, Any]
"""The contents of ``results.json``."""


def case_table(document: Document) -> dict[str, list[Any]]:
    """One list a column, one element a case; names carry the unit, SI. None where a case has no such figure."""
    cases = document["cases"]

    def measured(name: str) -> list[Any]:
        return [case["measurements"].get(name) for case in cases]

    return {
        **{name: [case[name] for case in cases] for name in ("id", "status")},
        "configuration": [case["configuration"]["index"] for case in cases],
        **{f"{angle} [rad]": [case["configuration"][angle] for case in cases] for angle in ("q_a1", "q_a2")},
        **{name: [case[name] for case in cases] for name in ("system", "test")},
        "time [s]": [float(case["time"]) for case in cases],
        **{f"{name} [{entry['unit']}]": measured(name) for name, entry in document["criteria"].items()},
        "settled": measured("settled"),
        **{f"{name} [m]": measured(name) for name in ("limit_cycle_x", "limit_cycle_z", "rest_error")},
        **{name: [case[name] for case in cases] for name in ("warnings", "message")},
    }


def csv_text(document: Document) -> str:
    """The contents of ``cases.csv``, one row a case."""
    table = case_table(document)
    stream = io.StringIO()
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(table)
    writer.writerows(zip(*table.values(), strict=True))
    return stream.getvalue()


def parquet_bytes(document: Document) -> bytes:
    """The same table in Parquet, by the optional package pyarrow."""
    from pyarrow import BufferOutputStream, bool_, float64, parquet, table

    columns = table(case_table(document))
    for number, name in enumerate(columns.column_names):
        if columns.schema.field(name).type == "null":  # no case has such a figure
            kind = bool_() if name == "settled" else float64()
            columns = columns.set_column(number, name, columns.column(name).cast(kind))
    sink = BufferOutputStream()
    parquet.write_table(columns, sink)
    return sink.getvalue().to_pybytes()
