"""The result of an evaluation, as a user holds it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from ..benchmark.results import CaseResult, ConfigurationScore, CriterionScore, Requirement, Results
from .files import prepare_folder
from .recording import Recording
from .run import Run, load_run, save_run
from .wording import VERDICTS

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True)
class Evaluation:
    """How good and how robust a controller is; shows itself in a notebook.

    Parameters
    ----------
    results : Results
        Everything measured, the contents of ``results.json``; all values in SI units.
    recordings : tuple of Recording
        The few trajectories that a report shows.
    """

    results: Results
    recordings: tuple[Recording, ...] = ()

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
    def cases(self) -> tuple[CaseResult, ...]:
        """All cases, in the protocol's order."""
        return self.results.cases

    def to_pandas(self) -> pandas.DataFrame:
        """One row per case, the columns of ``cases.csv``. Needs the package pandas (the extra ``pandas``)."""
        from pandas import DataFrame

        from .tables import case_table

        return DataFrame(case_table(self.results))

    def save(self, folder: str | Path) -> Path:
        """Write ``results.json``, ``cases.csv`` and ``trajectories.npz`` into ``folder``, which is created if missing.

        What was made of other results there, such as a report, is removed. Raises :class:`InputError` if the folder
        cannot be written to, :class:`EnvironmentFault` if the disk is full.
        """
        save_run(self.results, self.recordings, Path(folder))
        return Path(folder)

    @classmethod
    def load(cls, folder: str | Path) -> Evaluation:
        """The evaluation that was saved in ``folder``; raises :class:`InputError` if it is damaged or not there."""
        run = load_run(Path(folder))
        return cls(run.results, run.recordings)

    def report(self, file: str | Path) -> Path:
        """Write the report, one HTML page that needs no network."""
        from .files import write_text
        from .report_page import report_html

        write_text(Path(file), report_html(self._run()))
        return Path(file)

    def figures(self, folder: str | Path) -> tuple[list[str], list[str]]:
        """Draw Figures 3, 4 and 8 to 12 of the paper as PDF, SVG and PNG.

        Returns the names of the figures drawn, and of those for which no trajectories were recorded.
        """
        from .figures import write_figures

        prepare_folder(Path(folder))
        return write_figures(self._run(), Path(folder))

    def _run(self) -> Run:
        return Run(self.results, self.recordings)

    def _repr_html_(self) -> str:
        from .fragments import results_fragment

        return results_fragment(self.results)

    def __repr__(self) -> str:
        cost = "no cost" if self.cost is None else f"V = {self.cost:.1f}"
        verdicts = ", ".join(f"{name} {VERDICTS[entry.passed]}" for name, entry in self.requirements.items())
        return f"Evaluation({self.results.controller.file}, {self.results.protocol}: {cost}, {verdicts})"
