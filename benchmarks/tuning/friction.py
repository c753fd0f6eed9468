"""Find the weights of the LQG design together with its dither: controller_fmu/friction/friction_weights.json.

python benchmarks/tuning/friction.py    (needs a C compiler and the extra ``tuning``; about 20 minutes on two cores)
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.tuning.task import Task, main  # noqa: E402

START = {
    "stiffness[1]": 4.4,
    "stiffness[2]": 2.1,
    "hardening": 0.19,
    "friction[1]": 0.013,
    "friction[2]": 0.0033,
    "drift[1]": 0.0004,
    "drift[2]": 0.00035,
    "motor_noise[1]": 0.19,
    "motor_noise[2]": 0.19,
    "arm_noise": 9.7,
    "push": 0.25,
    "push_time": 0.19,
    "angle_noise": 6.9e-05,
    "velocity": 0.11,
    "motor_angle": 7.6,
    "effort[1]": 0.06,
    "effort[2]": 0.25,
    "amplitude[1]": 8.5,
    "amplitude[2]": 5.0,
    "off": 3e-05,
    "rise": 3e-05,
    "memory": 0.72,
}
"""Where the search begins: as for the LQG alone, the dither by hand."""

UPPER = {"amplitude[1]": 25.0, "amplitude[2]": 15.0}
"""Of the amplitudes [N.m]: the drives give 35 and 20, and the feedback wants its share."""

TASK = Task(
    script=Path(__file__),
    file=ROOT / "controller_fmu" / "friction" / "friction_weights.json",
    shipped="DitheredLQG",
    fast="DitheredLQG_C",
    start=START,
    reach=1.5,
    upper=UPPER,
)

if __name__ == "__main__":
    main(TASK)
