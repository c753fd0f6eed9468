"""The results of an evaluation: what ``results.json`` holds, and every report of it is made from."""

from __future__ import annotations

from typing import ClassVar

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.results import CaseResult, ConfigurationScore, CriterionScore, Requirement, Scorecard
from ..benchmark.scorecard import score
from ..codec import NonNegative, Struct
from .document import Completeness, Document, completeness
from .files import CASES, FIGURES, MAT, PARQUET, REPORT, RESULTS, TRAJECTORIES


class LoopDelay(Struct):
    """From a measurement to the torque at the motor: the benchmark's T_d and the controller's own latency.

    ``seconds`` and ``samples`` are None if the latency could not be measured.
    """

    seconds: NonNegative | None
    samples: NonNegative | None
    benchmark: NonNegative
    controller_samples: int | None
    convention: str | None


class Results(Document, kw_only=True):
    """A scorecard, the cases it follows from, and what they were made with.

    ``cost`` is V of eq. (15), None if a criterion has no value. ``complete`` tells whether every case of the protocol
    ended with ``done`` or ``unstable``.
    """

    FILE: ClassVar[str] = RESULTS
    SCHEMA: ClassVar[str] = "flexible-manipulator-results/4"
    DERIVED: ClassVar[tuple[str, ...]] = (CASES, TRAJECTORIES, REPORT, PARQUET, MAT, FIGURES)

    complete: bool
    cost: NonNegative | None
    criteria: dict[str, CriterionScore]
    stability: dict[str, Requirement]
    configurations: tuple[ConfigurationScore, ...]
    cases: tuple[CaseResult, ...]
    loop_delay: LoopDelay

    @property
    def scorecard(self) -> Scorecard:
        """The scorecard alone."""
        return Scorecard(**{name: getattr(self, name) for name in Scorecard.__struct_fields__})

    def case(self, id: str) -> CaseResult:
        """The result of the case called ``id``; raises :class:`KeyError` if there is none."""
        for case in self.cases:
            if case.id == id:
                return case
        raise KeyError(id)

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        return completeness(self.cases, (entry.tally for entry in self.stability.values()))

    def _problem(self) -> str:
        tests = {test.name for test in self.rules.tests}
        names = [case.id for case in self.cases]
        if not self.cases or len(set(names)) < len(names) or not {case.test for case in self.cases} <= tests:
            return "its cases are not those of its rules"
        if not set(NOMINAL) <= set(self.plant.nominal):
            return "parameters of the plant are missing"
        return "" if score(self.rules, self.cases) == self.scorecard else "its scorecard is not that of its cases"
