"""Find the weights of the LQG design: controller_fmu/lqg/lqg_weights.json.

python benchmarks/tuning/lqg.py    (needs a C compiler and the extra ``tuning``; about 20 minutes on two cores)
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.tuning.task import Task, main  # noqa: E402

START = {
    "stiffness[1]": 7.3,
    "stiffness[2]": 4.2,
    "hardening": 1,
    "friction[1]": 0.031,
    "friction[2]": 0.012,
    "drift[1]": 0.00022,
    "drift[2]": 0.00036,
    "motor_noise[1]": 0.28,
    "motor_noise[2]": 0.92,
    "arm_noise": 11,
    "push": 0.28,
    "push_time": 0.048,
    "angle_noise": 0.00016,
    "velocity": 0.085,
    "motor_angle": 11,
    "effort[1]": 0.11,
    "effort[2]": 0.29,
}
"""Where the search begins: by hand from the orders of magnitude of noise, friction and disturbances, then rounded
from earlier searches."""

TASK = Task(
    script=Path(__file__),
    file=ROOT / "controller_fmu" / "lqg" / "lqg_weights.json",
    shipped="ManipulatorLQG",
    fast="DitheredLQG_C",
    start=START,
    reach=1.5,
    fixed={"amplitude[1]": 0.0, "amplitude[2]": 0.0},
)

if __name__ == "__main__":
    main(TASK)
