"""Recorded trajectories as a MAT file, for MATLAB and Octave."""

from __future__ import annotations

import io
from dataclasses import asdict

import numpy as np
from scipy.io import savemat

from .run import Run


def mat_bytes(run: Run) -> bytes:
    """A struct array ``recordings``: the fields of ``About``, and column vectors t, x, z, q_a1, q_a2, t_torque, u_m1
    and u_m2, in SI units. x, z, q_a1, q_a2 are changes from the beginning. The samples kept are not equidistant.
    """
    rows = []
    for entry in run.recordings:
        motion = dict(zip(("t", "x", "z", "q_a1", "q_a2"), entry.motion.T, strict=True))
        torque = dict(zip(("t_torque", "u_m1", "u_m2"), entry.torque.T, strict=True))
        columns = {name: column[:, None].astype(float) for name, column in {**motion, **torque}.items()}
        rows.append({**asdict(entry.about), "roles": ", ".join(entry.about.roles), **columns})
    recordings = np.array(rows, dtype=object) if rows else np.zeros(0)
    stream = io.BytesIO()
    savemat(stream, {"recordings": recordings, "seed": run.document["seed"]}, oned_as="column", do_compression=True)
    return stream.getvalue()
