"""Recorded trajectories as a MAT file, for MATLAB and Octave."""

from __future__ import annotations

import numpy as np
from scipy.io import savemat

from ..codec import plain
from .files import streamed
from .recording import MOTION, TORQUE, About
from .run import Run

COLUMNS = {name.split(" ")[0]: name for name in MOTION} | {
    name.split(" ")[0] if number else "t_torque": name for number, name in enumerate(TORQUE)
}
"""Columns of a recording by the names of their variables in MATLAB."""


def mat_bytes(run: Run) -> bytes:
    """A 1xN struct array ``recordings``: the fields of :class:`~.recording.About`, and column vectors t, x, z, q_a1,
    q_a2, t_torque, u_m1 and u_m2 in the units that the struct ``units`` names.

    x, z, q_a1, q_a2 are changes from the beginning. The samples kept are not equidistant.
    """
    names = [*About.__struct_fields__, *COLUMNS]
    # SciPy makes a cell array of dictionaries, and a struct array of a structured array only.
    recordings = np.empty((1, len(run.recordings)), dtype=[(name, object) for name in names])
    for number, entry in enumerate(run.recordings):
        columns = [column[:, None].astype(float) for column in (*entry.motion.T, *entry.torque.T)]
        about = {**plain(entry.about), "roles": ", ".join(entry.about.roles)}
        recordings[0, number] = (*about.values(), *columns)
    units = {name: column.split("[")[1].rstrip("]") for name, column in COLUMNS.items()}
    contents = {"recordings": recordings, "units": units, "seed": run.results.seed}
    return streamed(lambda stream: savemat(stream, contents, oned_as="column", do_compression=True))
