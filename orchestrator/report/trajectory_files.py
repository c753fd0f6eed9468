"""A trajectory as a CSV table, as a MAT file, and as a plot in the paper's axes."""

from __future__ import annotations

import io
import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from ..cosim import signals
from ..cosim.scenario import Scenario
from ..cosim.trajectory import Trajectory
from .files import write_bytes, write_text

OBSERVED = ("q_a[1]", "q_a[2]")
"""Plant outputs that are recorded beside q_m and X."""


def columns(trajectory: Trajectory, scenario: Scenario) -> dict[str, np.ndarray]:
    """All signals by name with unit, each of shape (N + 1,); torques of the last instant, not computed, are NaN."""
    t = trajectory.time
    u_d = np.array([signals.chirp(signals.chirp_signal(scenario.chirp), time) for time in t])
    F = np.array([signals.pulse(signals.pulse_signal(scenario.pulse), time) for time in t])
    pending = np.full((len(t) - len(trajectory.torque), 2), np.nan)
    torque = np.vstack([trajectory.torque, pending])
    command = np.vstack([trajectory.command, pending])
    pairs = {
        "q_m[{}] [rad]": trajectory.q_m,
        "u_c[{}] [N.m]": command,
        "u_m[{}] [N.m]": torque,
        "u_d[{}] [N.m]": u_d,
    }
    return {
        "time [s]": t,
        **{f"{name} [rad]": values for name, values in trajectory.extra.items()},
        **{name.format(i + 1): values[:, i] for name, values in pairs.items() for i in range(2)},
        "F_x [N]": F[:, 0],
        "F_z [N]": F[:, 1],
        "x [m]": trajectory.X[:, 0],
        "z [m]": trajectory.X[:, 1],
        "tcp_error [m]": trajectory.tcp_error,
    }


def write_csv(table: dict[str, np.ndarray], file: Path) -> None:
    """Write the columns with their names and units as header; numbers in full precision."""
    stream = io.StringIO()
    np.savetxt(
        stream, np.column_stack(list(table.values())), fmt="%.17g", delimiter=",", header=",".join(table), comments=""
    )
    write_text(file, stream.getvalue())


def write_mat(table: dict[str, np.ndarray], file: Path) -> None:
    """Write the columns as MATLAB variables: ``time``, ``q_m_1``, ..., ``tcp_error``; SI units as in the CSV file."""
    from scipy.io import savemat

    names = (re.sub(r"\W+", "_", name.split(" ")[0]).strip("_") for name in table)
    stream = io.BytesIO()
    savemat(stream, dict(zip(names, table.values(), strict=True)), oned_as="column", do_compression=True)
    write_bytes(file, stream.getvalue())


def write_plot(trajectory: Trajectory, scenario: Scenario, title: str, files: Sequence[Path]) -> None:
    """TCP error [mm] and torques [Nm] over time, with targets and limits where they are in sight."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout="constrained")
    error, torque = figure.subplots(2, 1, sharex=True)
    t = trajectory.time
    error.plot(t, trajectory.tcp_error * 1e3, linewidth=0.8)
    error.set(title=title, ylabel="TCP position error [mm]")
    for i in range(2):
        torque.step(t[:-1], trajectory.torque[:, i], where="post", linewidth=0.8, label=f"axis {i + 1}")
    torque.set(xlabel="Time [s]", ylabel="Motor torque $u_m$ [Nm]")
    torque.legend(loc="best")
    for axes in (error, torque):
        axes.grid(alpha=0.3)
        axes.set_xlim(t[0], t[-1] if len(t) > 1 else float(scenario.duration))
    for file in files:
        figure.savefig(file, dpi=150)
