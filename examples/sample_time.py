"""B5 against the controller's sample time: a study in one file, as CONTRIBUTING.md explains it.

python examples/sample_time.py my_controller.fmu --protocol quick --times 0.00025,0.0005,0.001
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import ClassVar

from orchestrator.benchmark.scorecard import score
from orchestrator.cli.guard import guarded
from orchestrator.cli.study import StudyCommand
from orchestrator.documents.document import Comparable, Document, Row
from orchestrator.pairing.controller import Controller
from orchestrator.pairing.testbed import Testbed
from orchestrator.study.declaration import Study, option
from orchestrator.study.heads import head
from orchestrator.study.requests import Batch, BatchEntry, Now, Requests, Save, rehearsed
from orchestrator.views.plot import Axis, Level, Line, Plot
from orchestrator.views.table import Column, Summary, Table
from orchestrator.views.units import MILLIMETRE, MILLISECOND


class SampleTimes(Document, Comparable, kw_only=True):
    """B5 [m] by sample time [s]; None where a loop that counts is unstable."""

    FILE: ClassVar[str] = "sample-times.json"
    SCHEMA: ClassVar[str] = "example-sample-times/1"
    KIND: ClassVar[str] = "B5 by sample time"

    times: tuple[float, ...]
    B5: tuple[float | None, ...]

    def _problem(self) -> str:
        return "" if len(self.times) == len(self.B5) else "it has not one B5 for each sample time"

    def summary(self) -> Summary:
        """A table and a plot."""
        columns = Column("sample time", MILLISECOND), Column("B5", MILLIMETRE, best="smallest")
        table = Table("Force error", columns, tuple(zip(self.times, self.B5, strict=True)))
        line, target = Line("B5", self.times, self.B5, symbol="circle"), self.rules.criteria["B5"].target
        x, y, levels = Axis("sample time", MILLISECOND), Axis("B5", MILLIMETRE), (Level(target, "target"),)
        plot = Plot("sample-times", "B5 over the sample time", x, y, (line,), levels)
        return Summary(self.controller.file, f"{self.benchmark}, protocol {self.protocol}", (table, plot))

    def row(self, first, others) -> Row:
        """B5 at each sample time."""
        columns = (Column(f"B5 at {1e3 * time:g} ms", MILLIMETRE, best="smallest") for time in self.times)
        return tuple(zip(columns, self.B5, strict=True))


@dataclass(frozen=True)
class SampleTimeStudy(Study[SampleTimes]):
    """B5 against the controller's sample time."""

    command, suffix = "sample_time", "-sample-times"

    times: Sequence[Fraction | float | str] = option((), "sample times [s], such as 0.0005,0.001", required=True)

    def ask(self, testbed: Testbed, controller: Controller, folder: Path | None = None) -> Requests[SampleTimes]:
        """The cases that B5 is measured in, at each of the times."""
        begin, B5 = (yield Now()), []
        for time in self.times:
            controller, pairing, T_s, cases = testbed.prepared(replace(controller, sample_time=time))
            measured = tuple(case for case in cases if "B5" in case.test.criteria)
            yield from rehearsed(pairing, measured[0])
            (runs,) = yield Batch((BatchEntry(testbed.rules, pairing, measured),))
            document_head = head(testbed, controller, pairing, T_s, begin, (yield Now()))
            B5.append(score(document_head.rules, [run.result for run in runs]).criteria["B5"].value)
        times = tuple(map(float, self.times))
        document = SampleTimes(schema=SampleTimes.SCHEMA, head=document_head, times=times, B5=tuple(B5))
        yield Save(document)
        return document


main = StudyCommand(SampleTimeStudy, "B5 by sample time.", __doc__ or "", program="python examples/sample_time.py").main

if __name__ == "__main__":
    raise SystemExit(guarded(main))
