"""Find the parameters of RobustLQG against the worst cases found: controller_fmu/robust_c/robust_weights.json.

    python benchmarks/tuning/robust.py               three rounds of attack and repair from the values in the file
                                                     (needs a C compiler and the extra ``tuning``; about 20 minutes a
                                                     round on two cores)
    python benchmarks/tuning/robust.py --vary peak   only the parameters that begin with ``peak_``

A round attacks the controller with the project's search (``Benchmark.robustness``), which gives the worst member of
B5, B6 and B7 at each configuration. These members are added to those of earlier rounds, and CMA-ES makes V of all of
them small (eqs. (14) and (15): the largest value of each criterion at each configuration). Stability tests with more
gain and delay than A1 and A2 ask for are a penalty. Members are simulated as the search simulates them, in short
simulations: B5 with the force alone, B6 and B7 with the whole chirp, where all three criteria count.

The members are kept in runs/RobustLQG-tuning; a folder of an earlier search can be given as a further start.
"""

from __future__ import annotations

import argparse
import json
import math
import sys
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import NamedTuple

import numpy as np
from cmaes import CMA

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

from benchmarks.tuning.task import origin  # noqa: E402
from orchestrator import Benchmark, Controller, Robustness  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402
from orchestrator.benchmark.results import Judgement  # noqa: E402
from orchestrator.codec import pack, unpack  # noqa: E402
from orchestrator.fmi.archive import Archive  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop.setup import Setup  # noqa: E402
from orchestrator.pairing.testbed import available_cores  # noqa: E402
from orchestrator.pairing.work import CaseTask, judge_case  # noqa: E402
from orchestrator.search.member import Member, case_of, names  # noqa: E402
from orchestrator.search.short import short  # noqa: E402
from orchestrator.search.target import targets  # noqa: E402

FILE = ROOT / "controller_fmu" / "robust_c" / "robust_weights.json"
RUNS = ROOT / "runs" / "RobustLQG-tuning"

STRICT = Benchmark("strict")
PROTOCOL = STRICT.rules
TARGETS = {target.name: target for target in targets(PROTOCOL)}
CRITERIA = ("B5", "B6", "B7")
UNSTABLE = {"B5": 0.1, "B6": 10.0, "B7": 0.02}
"""What counts for a criterion that a simulation does not come to [m, s, m]."""

KEPT = ("T_s", "period", "headroom", "peak_time", "peak_regain", "dither_time", "spent")
"""Parameters that are not varied: choices, and what A1 and A2 depend on beyond the time that a simulation shows."""

LEAST = {"jump": 1e-3, "jump_contrast": 2.5, "dithered": 1.0}
"""Smallest values: a chirp must not begin a peak."""

GAIN, DELAY = 1.15 * 2.5, Fraction(2, 1000)
"""Loop gain and additional delay [s] of the stability tests, in place of A1's 2.5 and A2's 1.5 ms."""

STABILITY_TESTS, STABILITY_WEIGHT = 16, 10.0
SETTLED, PEAKED = 3.0, 0.4
"""Time after the force [s] that B6 is waited for, and that the others are simulated for."""


class Arm(NamedTuple):
    """A member, and the criterion that it is the worst of; that of a stability test is empty."""

    criterion: str
    member: Member


@dataclass(frozen=True)
class Judged:
    """What a candidate comes to: the criteria [m, s, m], their part of V, and the penalty of its stability tests."""

    criteria: Mapping[str, float]
    cost: float
    penalty: float

    @property
    def objective(self) -> float:
        """What is made small."""
        return self.cost + self.penalty


def attacked(parameters: Mapping[str, float], budget: int, folder: Path, restarts: int = 1) -> Robustness:
    """The worst case of a candidate, as far as the search finds it."""
    controller = Controller.built_in("RobustLQG").with_parameters(parameters)
    return STRICT.robustness(controller, budget=budget, restarts=restarts, folder=folder)


def arms_of(found: Robustness) -> list[Arm]:
    """The worst members that a search found, one for each criterion and configuration."""
    poses = {entry.index: (entry.q_a1, entry.q_a2) for entry in found.configurations}
    return [
        Arm(
            peak.criterion,
            Member(
                (round(math.degrees(q_a[0]), 9), round(math.degrees(q_a[1]), 9)),
                TARGETS[peak.criterion].test,
                tuple(peak.deviations.items()),
                phi_F=peak.phi_F,
                sweep=peak.sweep,
                seed=peak.seed,
            ),
        )
        for peak in found.peaks
        for q_a in [poses[peak.configuration]]
    ]


def stability_arms(poses: Sequence[tuple[float, float]], seed: int = 5) -> list[Arm]:
    """Stability tests of random corners of Table 1 with more gain or delay than asked for; axis 1 is the harder one."""
    stream, own, found = np.random.default_rng(seed), Fraction(1, 4000), []
    gains = {"gain_1": (GAIN, 1.0), "gain_2": (1.0, GAIN)}
    delays = {"delay_1": (own + DELAY, own), "delay_2": (own, own + DELAY)}
    order = ("gain_1", "gain_1", "delay_1", "gain_1", "gain_2", "delay_1", "gain_1", "delay_2")
    for number in range(STABILITY_TESTS):
        test = order[number % len(order)]
        signs = tuple((name, float(stream.choice([-1.0, 1.0]))) for name in names(PROTOCOL))
        member = Member(
            poses[int(stream.integers(len(poses)))],
            test,
            signs,
            phi_F=float(stream.uniform(0.0, 2.0 * math.pi)),
            sweep=PROTOCOL.disturbance.chirp_frequencies,
            gain=gains.get(test),
            delay=delays.get(test),
            seed=int(stream.integers(1000)),
        )
        found.append(Arm("", member))
    return found


def simulated(arm: Arm) -> Case:
    """The short simulation of an arm."""
    shown = TARGETS[arm.member.test] if not arm.criterion else TARGETS["B5" if arm.criterion == "B5" else "B6"]
    part = short(PROTOCOL, shown, SETTLED if arm.criterion == "B6" else PEAKED)
    return case_of(replace(arm.member, short=part), PROTOCOL, STRICT.nominal)


SLAVES: list[Slave] = []
"""Plant and controller of this process."""


def begin(plant: Archive, controller: Archive) -> None:
    """Load both in a process of the pool: they are the project's own, and need no process for each case."""
    SLAVES[:] = load(plant), load(controller)


def judged(case: Case, parameters: Mapping[str, float]) -> Judgement:
    """Simulate a case with these parameters of the controller."""
    task = pack(CaseTask(PROTOCOL, Setup(parameters=parameters), case))
    return unpack(judge_case(SLAVES[0], SLAVES[1], task), Judgement)


def summed(arms: Sequence[Arm], results: Iterable[Judgement]) -> Judged:
    """What the results of all arms come to."""
    values: dict[str, dict[tuple[float, float], list[float]]] = defaultdict(lambda: defaultdict(list))
    penalty = 0.0
    for arm, result in zip(arms, results, strict=True):
        figures = result.measurements
        if not arm.criterion:
            size = math.log10(max(figures.limit_cycle or 1e-9, 1e-9) / (0.5 * PROTOCOL.stability.limit_cycle))
            lasts = figures.limit_cycle is None or (figures.limit_cycle_ratio or 0.0) > PROTOCOL.stability.ring_down
            penalty += STABILITY_WEIGHT * (min(max(size, 0.0), 1.0) if figures.limit_cycle is not None else 1.0) * lasts
            continue
        for name in ("B5",) if arm.criterion == "B5" else CRITERIA:
            value = getattr(figures, name)
            values[name][arm.member.q_a].append(UNSTABLE[name] if value is None else value)
    criteria = {name: sum(map(max, by_pose.values())) / len(by_pose) for name, by_pose in values.items()}
    spec = PROTOCOL.criteria
    return Judged(criteria, sum(spec[name].weight * criteria[name] / spec[name].target for name in criteria), penalty)


class Tuning:
    """Candidates on all arms known, with one process for each core."""

    def __init__(self, arms: Sequence[Arm]) -> None:
        self.arms = (*arms, *stability_arms(sorted({arm.member.q_a for arm in arms})))
        self.cases = [simulated(arm) for arm in self.arms]
        pairing = STRICT.prepared(Controller.built_in("RobustLQG"))[1]
        self.pool = ProcessPoolExecutor(
            available_cores(), initializer=begin, initargs=(pairing.plant, pairing.controller)
        )

    def __call__(self, parameters: Mapping[str, float]) -> Judged:
        """Judge one candidate."""
        results = self.pool.map(judged, self.cases, [parameters] * len(self.cases), chunksize=3)
        return summed(self.arms, results)


def repaired(
    start: Mapping[str, float], vary: Sequence[str], arms: Sequence[Arm], generations: int, sigma: float, seed: int
) -> dict[str, float]:
    """The best parameters that CMA-ES finds, which varies the logarithms of those named in ``vary``."""
    tuning = Tuning(arms)
    sampler = CMA(mean=np.log([start[name] for name in vary]), sigma=sigma, seed=seed)
    best, chosen = tuning(start), dict(start)
    print(f"{len(arms)} arms; at the start {best}", flush=True)
    for _ in range(generations):
        tried = []
        for _ in range(sampler.population_size):
            point = sampler.ask()
            values = {name: float(f"{math.exp(x):.4g}") for name, x in zip(vary, point, strict=True)}
            candidate = {**start, **values, **{k: max(values[k], low) for k, low in LEAST.items() if k in values}}
            found = tuning(candidate)
            # Unstable candidates are told apart, but one of them must not decide the scale of a generation.
            tried.append((point, min(found.objective, 300.0 + 0.01 * found.objective)))
            if found.objective < best.objective:
                best, chosen = found, candidate
        sampler.tell(tried)
        shown = ", ".join(f"{name} {value:.4g}" for name, value in best.criteria.items())
        print(f"{sampler.generation}: {best.objective:.2f} ({shown}; penalty {best.penalty:.2f})", flush=True)
    tuning.pool.shutdown()
    return chosen


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description="Find the parameters of RobustLQG against its worst cases.")
    parser.add_argument("--rounds", type=int, default=3, metavar="N", help="of attack and repair (default: 3)")
    parser.add_argument(
        "--budget", type=int, default=3000, metavar="N", help="whole cases of an attack (default: 3000)"
    )
    parser.add_argument("--generations", type=int, default=20, metavar="N", help="of a repair (default: 20)")
    parser.add_argument("--sigma", type=float, default=0.1, help="first standard deviation of the logarithms")
    parser.add_argument("--seed", type=int, default=1, help="of CMA-ES")
    parser.add_argument("--vary", default="", metavar="PREFIX", help="only the parameters that begin so")
    parser.add_argument("--known", type=Path, nargs="*", default=(), metavar="FOLDER", help="searches to begin with")
    given = parser.parse_args()
    parameters: dict[str, float] = json.loads(FILE.read_text(encoding="utf-8"))["parameters"]
    vary = [
        name for name, value in parameters.items() if name.startswith(given.vary) and name not in KEPT and value > 0.0
    ]
    arms = [arm for folder in given.known for arm in arms_of(Robustness.load(folder))]
    for number in range(given.rounds):
        found = attacked(parameters, given.budget, RUNS / f"round-{number}")
        print(f"round {number}: V found {found.cost:.1f}, {found.broken or 'no failure found'}", flush=True)
        arms += arms_of(found)
        parameters = repaired(parameters, vary, arms, given.generations, given.sigma, given.seed + number)
        contents = {
            "tuned": {**origin(Path(__file__)), **vars(given), "known": len(given.known)},
            "parameters": parameters,
        }
        FILE.write_text(json.dumps(contents, indent=1) + "\n", encoding="utf-8")
    found = attacked(parameters, given.budget, RUNS / "end")
    print(f"in the end: V found {found.cost:.1f}, {found.broken or 'no failure found'}")


if __name__ == "__main__":
    main()
