"""Find the weights of the LQG design together with its dither: friction_weights.json.

python -m controller_fmu.friction.tune    (needs a C compiler and the extra ``tuning``; about 20 minutes on two cores)
"""

from __future__ import annotations

from pathlib import Path

from controller_fmu.tuning import Task, main

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
    file=Path(__file__).with_name("friction_weights.json"),
    shipped="DitheredLQG",
    fast="DitheredLQG_C",
    start=START,
    reach=1.5,
    upper=UPPER,
)

if __name__ == "__main__":
    main(TASK)
