"""A run: the results of an evaluation and its recordings, on disk and back; and the recordings as a MAT file."""

from __future__ import annotations

import logging
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from msgspec.structs import replace

from ..bounded import MAX_RESULT_BYTES, read
from ..codec import Malformed, from_json, plain, to_json
from ..errors import InputError
from ..loop.trajectory import Status
from . import recording
from .case_table import cases_csv
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
from .results import Results

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
        shown["B5"] = float(np.max(entry.error[entry.motion[:, 0] >= entry.about.window[0]], initial=0.0))
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
        about = {**plain(entry.about), "roles": ", ".join(entry.about.roles)}
        recordings[0, number] = (*about.values(), *columns)
    units = {name: column.split("[")[1].rstrip("]") for name, column in MAT_COLUMNS.items()}
    contents = {"recordings": recordings, "units": units, "seed": run.results.seed}
    return streamed(lambda stream: savemat(stream, contents, oned_as="column", do_compression=True))
