"""The results of an evaluation: what ``results.json`` holds, and every report of it is made from.

Its cases also become tables: in a notebook, as CSV, and as Parquet for pandas or a database. A run is results and
recordings, on disk and back; the recordings become a MAT file, too.
"""

from __future__ import annotations

import logging
import math
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from msgspec.structs import replace

from plant_fmu.flexible_manipulator.parameters import NOMINAL

from ..benchmark.case import Case
from ..benchmark.metrics import FIRST_AND_LATER
from ..benchmark.results import CaseResult, ConfigurationScore, CriterionScore, Measurements, Requirement, Scorecard
from ..benchmark.scorecard import score
from ..bounded import MAX_RESULT_BYTES, read
from ..codec import Malformed, NonNegative, Struct, convert, from_json, plain, to_json
from ..errors import InputError
from ..loop.scenario import Recurrence
from ..loop.trajectory import Status
from ..views.export import csv_text
from ..views.table import Column, Summary, Table, VerdictCell
from ..views.units import SECOND
from . import recording
from .document import Completeness, Displayable, Document, completeness
from .files import (
    CASES,
    FIGURES,
    MAT,
    PARQUET,
    REPORT,
    RESULTS,
    TRAJECTORIES,
    prepare_folder,
    remove,
    streamed,
    write_text,
)
from .recording import MOTION, SYSTEMS, TORQUE, About, Recording

# Imports inside functions: pyarrow is optional.


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
    SCHEMA: ClassVar[str] = "flexible-manipulator-results/5"
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

    @classmethod
    def _of_older(cls, form: str, text: bytes) -> Results | None:
        return of_form_4(text) if form == FORM_4 else None

    def _problem(self) -> str:
        tests = {test.name for test in self.rules.tests}
        names = [case.id for case in self.cases]
        if not self.cases or len(set(names)) < len(names) or not {case.test for case in self.cases} <= tests:
            return "its cases are not those of its rules"
        if not set(NOMINAL) <= set(self.plant.nominal):
            return "parameters of the plant are missing"
        return "" if score(self.rules, self.cases) == self.scorecard else "its scorecard is not that of its cases"


FORM_4 = "flexible-manipulator-results/4"
"""Of the versions of the benchmark up to 3."""


class MeasurementsOfForm4(Measurements):
    """Its amplitudes [m] are half the peak-to-peak of the TCP's x and of its z; the larger one was judged."""

    limit_cycle_x: NonNegative | None = None
    limit_cycle_z: NonNegative | None = None


class CaseOfForm4(CaseResult, kw_only=True):
    """A case with these."""

    measurements: MeasurementsOfForm4


class ResultsOfForm4(Results, kw_only=True):
    """Results with these; A3 has a verdict for each coordinate."""

    cases: tuple[CaseOfForm4, ...]


def of_form_4(text: bytes) -> Results:
    """Results of the form 4 in this one: the same verdicts, by the larger amplitude. Raises :class:`Malformed`."""
    contents = plain(from_json(text, ResultsOfForm4)) | {"schema": Results.SCHEMA}
    for case in contents["cases"]:
        figures = case["measurements"]
        sizes = [figures.pop(name) for name in ("limit_cycle_x", "limit_cycle_z") if name in figures]
        figures |= {"limit_cycle": max(sizes)} if sizes else {}
    contents["stability"].get("A3", {})["axes"] = {}
    return convert(contents, Results)


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
        **{f"{name} [m]": measured(name) for name in ("limit_cycle", "rest_error")},
        "limit_cycle_ratio": measured("limit_cycle_ratio"),
        "limit_cycle_frequency [Hz]": measured("limit_cycle_frequency"),
        "recovery [s]": measured("recovery"),
        **(
            {f"{name} [s]": measured(name) for name in FIRST_AND_LATER}
            if any(value is not None for value in measured(FIRST_AND_LATER[0]))
            else {}
        ),
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


SINGLE = 1e-5
"""Relative error that the single precision of recordings may make."""

MAT_COLUMNS = {name.split(" ")[0]: name for name in MOTION} | {
    name.split(" ")[0] if number else "t_torque": name for number, name in enumerate(TORQUE)
}
"""Columns of a recording by the names of their variables in MATLAB."""


logger = logging.getLogger(__name__)


@dataclass(frozen=True)
class Run:
    """``results`` and ``recordings``, which may be empty; ``folder`` is where they are stored, if they are."""

    results: Results
    recordings: tuple[Recording, ...] = ()
    folder: Path | None = None

    def recorded(self, role: str) -> list[Recording]:
        """The recordings with this role, such as ``B5``, ``A2 2`` or ``spread``."""
        return [entry for entry in self.recordings if role in entry.about.roles]


def contradictions(run: Run) -> list[str]:
    """Recordings that do not show what the results say of their case, in words.

    Both come from the same simulation, done twice: a difference is a fault, or somebody's work.
    """
    cases = {case.id: case for case in run.results.cases}
    differences = []
    for entry in run.recordings:
        case = cases.get(entry.about.id)
        if case is None or case.status is not Status.DONE or SYSTEMS in entry.about.roles:
            continue
        torques = np.max(np.abs(entry.torque[:, 1:]), axis=0, initial=0.0)
        shown = {"B3": float(torques[0]), "B4": float(torques[1])}
        pushed = [recording.within(entry, push.window[0], push.until) for push in entry.about.pushes]
        shown["B5"] = float(np.max(entry.error[np.any(pushed, axis=0)], initial=0.0))
        for name, value in shown.items():
            told = getattr(case.measurements, name)
            if told is not None and not math.isclose(value, told, rel_tol=SINGLE):
                differences.append(f"{case.id}: {name} is {told:.6g} in the results, {value:.6g} in the recording")
    return differences


def save_run(run: Run, folder: Path) -> None:
    """Write ``cases.csv``, ``trajectories.npz`` and ``results.json`` into ``folder``, each in one go, the summary last.

    What was made of other results that are there is removed first: what is kept belongs to the run's results, whenever
    the process is interrupted.
    """
    prepare_folder(folder)
    if _is_outdated(folder, run.results):
        logger.warning("other results in %s are replaced", folder, extra={"what": "replaced"})
        for name in (RESULTS, CASES, TRAJECTORIES, REPORT, PARQUET, MAT, FIGURES):
            remove(folder / name)
    if run.recordings:
        recording.save(run.recordings, folder)
    write_text(folder / CASES, cases_csv(run.results))
    write_text(folder / RESULTS, to_json(run.results) + "\n")


def _is_outdated(folder: Path, results: Results) -> bool:
    """Whether ``folder`` holds other results."""
    try:
        there = from_json(read(folder / RESULTS, MAX_RESULT_BYTES), Results)
    except InputError as problem:
        return not isinstance(problem.__cause__, FileNotFoundError)
    except Malformed:
        return True
    # These differ from one run to the next, also where nothing that counts does.
    head = replace(
        there.head, timing=results.timing, environment=results.head.environment, command=results.head.command
    )
    return replace(there, head=head) != results


def load_run(path: Path) -> Run:
    """The run in the folder ``path`` (or of that results file).

    Raises :class:`InputError` if it is damaged, contradicts itself, or is not there.
    """
    folder = path if path.is_dir() else path.parent
    return Run(Results.load(path), recording.load(folder), folder)


def mat_bytes(run: Run) -> bytes:
    """A 1xN struct array ``recordings``: the fields of :class:`~.recording.About`, and column vectors t, x, z, q_a1,
    q_a2, t_torque, u_m1 and u_m2 in the units that the struct ``units`` names.

    x, z, q_a1, q_a2 are changes from the beginning. The samples kept are not equidistant.
    """
    from scipy.io import savemat  # loaded by those who need it

    names = [*About.__struct_fields__, *MAT_COLUMNS]
    # SciPy makes a cell array of dictionaries, and a struct array of a structured array only.
    recordings = np.empty((1, len(run.recordings)), dtype=[(name, object) for name in names])
    for number, entry in enumerate(run.recordings):
        columns = [column[:, None].astype(float) for column in (*entry.motion.T, *entry.torque.T)]
        about = {name: plain(getattr(entry.about, name)) for name in About.__struct_fields__}
        about |= {"roles": ", ".join(entry.about.roles), "again": plain(entry.about.again or Recurrence())}
        recordings[0, number] = (*about.values(), *columns)
    units = {name: column.split("[")[1].rstrip("]") for name, column in MAT_COLUMNS.items()}
    contents = {"recordings": recordings, "units": units, "seed": run.results.seed}
    return streamed(lambda stream: savemat(stream, contents, oned_as="column", do_compression=True))
