"""The result of an evaluation, as a user holds it."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, ClassVar

from ..benchmark.results import ConfigurationScore, CriterionScore, Requirement
from ..entry import entered
from ..views.table import VERDICTS, Page, Summary
from . import report_page, scorecard
from .document import Comparable, Completeness, Rank, Row
from .files import prepare_folder
from .head import Head
from .results import Cases, Run, case_table, load_run, save_run
from .wording import without_cost

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Evaluation(Run, Comparable):
    """How good and how robust a controller is; shows itself in a notebook.

    Parameters
    ----------
    results : Results
        Everything measured, the contents of ``results.json``; all values in SI units.
    recordings : tuple of Recording
        The few trajectories that a report shows.
    folder : path, optional
        Where it is stored, if it is.
    """

    KIND: ClassVar[str] = "Evaluations"

    @property
    def cost(self) -> float | None:
        """V of eq. (15); None if a case that counts has no value."""
        return self.results.cost

    @property
    def complete(self) -> bool:
        """Whether every case of the protocol ended with ``done`` or ``unstable``."""
        return self.results.complete

    @property
    def criteria(self) -> Mapping[str, CriterionScore]:
        """B1 to B7 over the workspace, with ``value``, ``target``, ``share`` of V and ``worst_case``."""
        return self.results.criteria

    @property
    def requirements(self) -> Mapping[str, Requirement]:
        """A1 to A3, with ``passed`` (None: not judged), ``reason``, ``limit_cycle`` [m], ``worst_case`` and the
        verdicts by ``axes``."""
        return self.results.stability

    @property
    def configurations(self) -> tuple[ConfigurationScore, ...]:
        """V_k of eq. (14) and the relative criteria b_i by configuration."""
        return self.results.configurations

    @property
    def cases(self) -> Cases:
        """All cases, in the protocol's order."""
        return Cases(self.results.cases)

    def to_pandas(self) -> pandas.DataFrame:
        """One row per case, the columns of ``cases.csv``. Needs the package pandas (the extra ``pandas``)."""
        from pandas import DataFrame  # optional

        return DataFrame(case_table(self.results))

    def save(self, folder: str | Path) -> Path:
        """Write ``results.json``, ``cases.csv`` and ``trajectories.npz`` into ``folder``, which is created if missing.

        What was made of other results there, such as a report, is removed. Raises :class:`InputError` if the folder
        cannot be written to, :class:`EnvironmentFault` if the disk is full.
        """
        save_run(self, Path(folder))
        return Path(folder)

    @classmethod
    @entered
    def load(cls, folder: str | Path) -> Evaluation:
        """The evaluation that was saved in ``folder``; raises :class:`InputError` if it is damaged or not there."""
        return cls(**vars(load_run(Path(folder))))

    @property
    def head(self) -> Head:
        """What it was made with."""
        return self.results.head

    @property
    def completeness(self) -> Completeness:
        """See :attr:`.Document.completeness`."""
        return self.results.completeness

    @property
    def rank(self) -> Rank:
        """See :class:`.Comparable`."""
        return Rank(self.cost, all(entry.passed for entry in self.requirements.values()), self._reason)

    @property
    def _reason(self) -> str:
        """Why it has no rank; empty if it has one."""
        if self.complete and self.cost is not None:
            return ""
        failed = Counter(case.status.value for case in self.cases if not case.simulated)
        if failed:
            return "incomplete: " + ", ".join(f"{count} {status}" for status, count in failed.items())
        return without_cost(self.results) or "incomplete: not all cases of the protocol were run"

    def row(self, first: Comparable | None, others: Sequence[tuple[str, Comparable]]) -> Row:
        """V, the criteria, and the verdicts."""
        return scorecard.row(self.results)

    def summary(self) -> Summary:
        """The scorecard."""
        return scorecard.summary(self.results)

    def page(self) -> Page:
        """The report: the scorecard, the workspace, time plots, stability, and the arm in motion."""
        return report_page.page(self)

    def figures(self, folder: str | Path) -> tuple[list[str], list[str]]:
        """Draw Figures 3, 4 and 8 to 12 of the paper as PDF, SVG and PNG.

        Returns the names of the figures drawn, and of those for which no trajectories were recorded.
        """
        from .figures import write_figures  # Matplotlib takes as long to load as the rest of a command

        prepare_folder(Path(folder))
        return write_figures(self, Path(folder))

    def __repr__(self) -> str:
        cost = "no cost" if self.cost is None else f"V = {self.cost:.1f}"
        verdicts = ", ".join(f"{name} {VERDICTS[entry.passed]}" for name, entry in self.requirements.items())
        return f"Evaluation({self.results.controller.file}, {self.results.protocol}: {cost}, {verdicts})"
