"""Find the weights of the LQG design: lqg_weights.json.

python -m controller_fmu.lqg.tune              search, then the verdict by the whole protocol (2 to 3 minutes)
python -m controller_fmu.lqg.tune --verdict    only the verdict on the weights there are (about 20 seconds)
"""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from controller_fmu.friction.flexible_manipulator_dither import Dither
from controller_fmu.lqg import flexible_manipulator_lqg as lqg
from controller_fmu.tuning import search
from controller_fmu.tuning.problem import PAPER, LawOf
from controller_fmu.tuning.simulator import NO_DITHER, Law

WEIGHTS = Path(__file__).with_name("lqg_weights.json")
EVALUATIONS, SPREAD, SEED = 210, 0.12, 1

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


def weights(values: Mapping[str, float]) -> lqg.Weights:
    """The design weights in a search's values; those with an index are pairs."""
    fields: dict[str, Any] = {}
    for name in lqg.Weights._fields:
        fields[name] = values[name] if name in values else (values[f"{name}[1]"], values[f"{name}[2]"])
    return lqg.Weights(**fields)


def law_of(chosen: lqg.Weights, dither: Dither = NO_DITHER) -> LawOf:
    """The controller with these weights, as the simulator wants it."""

    def law(q_m_ref: tuple[float, float], u_m0: tuple[float, float]) -> Law:
        recursion = lqg.controller(chosen, lqg.pose(q_m_ref, u_m0), float(PAPER.sample_time))
        return Law(lqg.law(recursion), dither)

    return law


def main() -> None:
    """Search, write, judge."""
    parser = argparse.ArgumentParser(description="Find the weights of the LQG design.")
    parser.add_argument("--verdict", action="store_true", help="no search")
    if not parser.parse_args().verdict:
        task = search.Task(START, lambda values: law_of(weights(values)))
        best, how = search.search(task, EVALUATIONS, SPREAD, SEED)
        search.write(WEIGHTS, Path(__file__), {"weights": weights(best)._asdict()}, how)
    search.verdict(law_of(lqg.read_weights(WEIGHTS)))


if __name__ == "__main__":
    main()
