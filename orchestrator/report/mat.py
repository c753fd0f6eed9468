"""Recorded trajectories as a MAT file, for MATLAB and Octave."""

from __future__ import annotations

import io
from dataclasses import asdict, fields

import numpy as np
from scipy.io import savemat

from .recording import About
from .run import Run

MOTION, TORQUE = ("t", "x", "z", "q_a1", "q_a2"), ("t_torque", "u_m1", "u_m2")
"""Names of the columns of a recording."""


def mat_bytes(run: Run) -> bytes:
    """A 1xN struct array ``recordings``: the fields of ``About``, and column vectors t, x, z, q_a1, q_a2, t_torque,
    u_m1 and u_m2, in SI units. x, z, q_a1, q_a2 are changes from the beginning. The samples kept are not equidistant.
    """
    names = [*(field.name for field in fields(About)), *MOTION, *TORQUE]
    # SciPy makes a cell array of dictionaries, and a struct array of a structured array only.
    recordings = np.empty((1, len(run.recordings)), dtype=[(name, object) for name in names])
    for number, entry in enumerate(run.recordings):
        columns = [column[:, None].astype(float) for column in (*entry.motion.T, *entry.torque.T)]
        about = {**asdict(entry.about), "roles": ", ".join(entry.about.roles)}
        recordings[0, number] = (*about.values(), *columns)
    stream = io.BytesIO()
    savemat(stream, {"recordings": recordings, "seed": run.document["seed"]}, oned_as="column", do_compression=True)
    return stream.getvalue()
