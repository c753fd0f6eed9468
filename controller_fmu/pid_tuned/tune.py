"""Find gains of the PID, eq. (13): tuned_pid_gains.json.

python -m controller_fmu.pid_tuned.tune              search, then the verdict by the whole protocol (2 to 3 minutes)
python -m controller_fmu.pid_tuned.tune --verdict    only the verdict on the gains there are (about 20 seconds)
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from controller_fmu.tuning import search
from controller_fmu.tuning.problem import PAPER, LawOf
from controller_fmu.tuning.simulator import Law

GAINS = Path(__file__).with_name("tuned_pid_gains.json")
EVALUATIONS, SPREAD, SEED = 210, 0.2, 1

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

UPPER = {"z_p[1]": 0.99, "z_p[2]": 0.99}


def gains(values: Mapping[str, float]) -> dict[str, tuple[float, float]]:
    """The pairs in a search's values."""
    return {name: (values[f"{name}[1]"], values[f"{name}[2]"]) for name in ("K_p", "K_i", "K_d", "z_p")}


def law_of(chosen: Mapping[str, Sequence[float]]) -> LawOf:
    """The PID as the simulator wants it; its state is (e, v, s) of axis 1, then of axis 2, with e = q_m - q_m_ref.

    The recursion of controller_fmu/pid/diagonal_pid_fmu.py, with the sign of the error turned.
    """
    T_s = float(PAPER.sample_time)
    step, output = np.zeros((6, 10)), np.zeros((2, 6))
    for i in (0, 1):
        K_p, K_i, K_d, z_p = (chosen[name][i] for name in ("K_p", "K_i", "K_d", "z_p"))
        e, v, s, measured = 3 * i, 3 * i + 1, 3 * i + 2, 8 + i
        step[e, measured] = 1.0
        step[v, [v, measured, e]] = z_p, (1.0 - z_p) / T_s, -(1.0 - z_p) / T_s
        step[s, [s, measured]] = 1.0, K_i * T_s
        output[i, [e, v, s]] = -K_p, -K_d, -1.0
    law = Law(np.vstack([step, output @ step, np.zeros((2, 10))]))
    return lambda q_m_ref, u_m0: law


def main() -> None:
    """Search, write, judge."""
    parser = argparse.ArgumentParser(description="Find gains of the PID.")
    parser.add_argument("--verdict", action="store_true", help="no search")
    if not parser.parse_args().verdict:
        task = search.Task(START, lambda values: law_of(gains(values)), UPPER)
        best, how = search.search(task, EVALUATIONS, SPREAD, SEED)
        search.write(GAINS, Path(__file__), {"gains": gains(best)}, how)
    search.verdict(law_of(json.loads(GAINS.read_text(encoding="utf-8"))["gains"]))


if __name__ == "__main__":
    main()
