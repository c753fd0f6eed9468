"""Find gains of the PID, eq. (13): controller_fmu/pid_tuned/tuned_pid_gains.json.

python benchmarks/tuning/pid_tuned.py    (needs a C compiler and the extra ``tuning``; about 20 minutes on two cores)
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.tuning.task import Task, main  # noqa: E402

START = {
    "K_p[1]": 45.0,
    "K_p[2]": 15.0,
    "K_i[1]": 30.0,
    "K_i[2]": 10.0,
    "K_d[1]": 1.0,
    "K_d[2]": 0.3,
    "z_p[1]": 0.90,
    "z_p[2]": 0.90,
}
"""Where the search begins: the paper's gains with less derivative action and faster filters, which lets A2 hold."""

TASK = Task(
    script=Path(__file__),
    file=ROOT / "controller_fmu" / "pid_tuned" / "tuned_pid_gains.json",
    shipped="TunedPID",
    fast="DiagonalPID_C",
    start=START,
    reach=2.0,
    upper={"z_p[1]": 0.99, "z_p[2]": 0.99},
)

if __name__ == "__main__":
    main(TASK)
