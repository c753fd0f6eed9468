"""Find the weights of the LQG design together with its dither: friction_weights.json.

python -m controller_fmu.friction.tune              search, then the verdict by the whole protocol (2 to 3 minutes)
python -m controller_fmu.friction.tune --verdict    only the verdict on the weights there are (about 20 seconds)
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Mapping
from pathlib import Path

from controller_fmu.friction.flexible_manipulator_dither import Dither, read_dither
from controller_fmu.lqg import flexible_manipulator_lqg as lqg
from controller_fmu.lqg.tune import law_of, weights
from controller_fmu.tuning import search
from controller_fmu.tuning.problem import PAPER

WEIGHTS = Path(__file__).with_name("friction_weights.json")
EVALUATIONS, SPREAD, SEED = 210, 0.12, 1
PERIOD = 16.0
"""Of the dither [samples]: 250 Hz. 500 Hz moves the motors less and costs about 1 of V; slower ones gain half of
that at most."""

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
"""Where the search begins: as for the LQG alone, the dither by hand. ``rise`` [m] is from ``off`` to full strength."""

UPPER = {"amplitude[1]": 25.0, "amplitude[2]": 15.0}
"""Of the amplitudes [N.m]: the drives give 35 and 20, and the feedback wants its share."""


def dither(values: Mapping[str, float]) -> Dither:
    """The dither in a search's values."""
    return Dither(
        amplitude_1=values["amplitude[1]"],
        amplitude_2=values["amplitude[2]"],
        period=PERIOD,
        off=values["off"],
        full=values["off"] + values["rise"],
        forget=math.exp(-float(PAPER.sample_time) / values["memory"]),
    )


def main() -> None:
    """Search, write, judge."""
    parser = argparse.ArgumentParser(description="Find the weights of the LQG design and of the dither.")
    parser.add_argument("--verdict", action="store_true", help="no search")
    if not parser.parse_args().verdict:
        task = search.Task(START, lambda values: law_of(weights(values), dither(values)), UPPER)
        best, how = search.search(task, EVALUATIONS, SPREAD, SEED)
        entries = {"weights": weights(best)._asdict(), "dither": dither(best)._asdict()}
        search.write(WEIGHTS, Path(__file__), entries, how)
    search.verdict(law_of(lqg.read_weights(WEIGHTS), read_dither(WEIGHTS)))


if __name__ == "__main__":
    main()
