"""Find the parameters of RobustLQG against the worst cases found: controller_fmu/robust_c/robust_weights.json.

    python benchmarks/tuning/robust.py                three rounds of attack and repair from the values in the file
                                                      (needs a C compiler and the extra ``tuning``; about 15 minutes a
                                                      round on two cores)
    python benchmarks/tuning/robust.py --vary peak    only the parameters that begin with ``peak``

A round attacks the controller with the project's search (``Benchmark.robustness``), which gives the worst member of
B5, B6 and B7 at each configuration. These members join those of earlier rounds and of the protocol ``strict``, and
CMA-ES makes V of all of them small (eqs. (14) and (15): the largest value of each criterion at each configuration).
Those stability tests of ``strict`` that end worst with more gain and delay than A1 and A2 ask for are a penalty.
Members are simulated as the search simulates them, in short simulations: B5 with the force alone, B6 and B7 with the
whole chirp, where all three criteria count.

The searches are kept in runs/RobustLQG-tuning; ``--known`` begins with the worst members of other ones.
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
from controller_fmu.robust_c.interface import SLOW  # noqa: E402
from orchestrator import Benchmark, Controller, Robustness  # noqa: E402
from orchestrator.benchmark.case import Case  # noqa: E402
from orchestrator.benchmark.results import Judgement  # noqa: E402
from orchestrator.codec import pack, unpack  # noqa: E402
from orchestrator.fmi.archive import Archive  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.loop.setup import Setup  # noqa: E402
from orchestrator.pairing.testbed import available_cores  # noqa: E402
from orchestrator.pairing.work import CaseTask, judge_case  # noqa: E402
from orchestrator.search.member import Member, case_of, of_case, spelled  # noqa: E402
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

KEPT = ("T_s", "period", "headroom", "peak_time", "peak_regain", "dither_time", "spent", *(row.name for row in SLOW))
"""Parameters that are not varied: choices, and what A1 and A2 depend on beyond the time that a simulation shows."""

LEAST = {"jump": 1e-3, "jump_contrast": 2.5, "dithered": 1.0}
"""Smallest values: a chirp must not begin a peak."""

GAIN, DELAY = 1.2 * 2.5, Fraction(2, 1000)
"""Loop gain and additional delay [s] of the stability tests, in place of A1's 2.5 and A2's 1.5 ms."""

B5_EVERY, STABILITY_TESTS = 6, 60
"""Every so many of the cases of ``strict`` with a force are taken, and so many of its stability tests: the worst."""

STABILITY_WEIGHT = 3.0
SETTLED, PEAKED, RESTED = 3.0, 0.4, Fraction(6)
"""Time after the force [s] that B6 is waited for, and that the others and the stability tests are simulated for."""


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


def attacked(parameters: Mapping[str, float], budget: int, folder: Path) -> Robustness:
    """The worst case of a candidate, as far as the search finds it."""
    controller = Controller.built_in("RobustLQG").with_parameters(parameters)
    return STRICT.robustness(controller, budget=budget, folder=folder)


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


def forced() -> list[Arm]:
    """Some of the cases of ``strict`` with a force, for B5."""
    cases = [case for case in STRICT.prepared(Controller.built_in("RobustLQG"))[3] if "B5" in case.test.criteria]
    return [Arm("B5", spelled(of_case(case), PROTOCOL, TARGETS["B5"].test)) for case in cases[::B5_EVERY]]


def tested() -> list[Arm]:
    """The stability tests of ``strict``, with more gain and delay."""
    _, _, _, cases = STRICT.prepared(Controller.built_in("RobustLQG"))
    own = Fraction(1, 4000)
    gains = {"gain_1": (GAIN, 1.0), "gain_2": (1.0, GAIN)}
    delays = {"delay_1": (own + DELAY, own), "delay_2": (own, own + DELAY)}
    members = [
        spelled(of_case(case), PROTOCOL, case.test.name) for case in cases if case.test.axis and not case.test.repeats
    ]
    return [Arm("", replace(each, gain=gains.get(each.test), delay=delays.get(each.test))) for each in members]


def simulated(arm: Arm) -> Case:
    """The short simulation of an arm."""
    shown = TARGETS[arm.member.test] if not arm.criterion else TARGETS["B5" if arm.criterion == "B5" else "B6"]
    part = short(PROTOCOL, shown, SETTLED if arm.criterion == "B6" else PEAKED)
    if part is not None and not arm.criterion:
        part = replace(part, duration=Fraction(part.t_2 or 0.0) + RESTED)
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
            penalty += STABILITY_WEIGHT * unrest(figures.limit_cycle, figures.limit_cycle_ratio)
            continue
        for name in ("B5",) if arm.criterion == "B5" else CRITERIA:
            value = getattr(figures, name)
            values[name][arm.member.q_a].append(UNSTABLE[name] if value is None else value)
    criteria = {name: sum(map(max, by_pose.values())) / len(by_pose) for name, by_pose in values.items()}
    spec = PROTOCOL.criteria
    return Judged(criteria, sum(spec[name].weight * criteria[name] / spec[name].target for name in criteria), penalty)


def unrest(amplitude: float | None, ratio: float | None) -> float:
    """How bad the end of a stability test is, 0 to 1: its amplitude [m], None if it is unstable, in decades from a
    limit cycle on if it lasts, and from 0.5 mm on if it does not."""
    if amplitude is None:
        return 1.0
    decades = math.log10(max(amplitude, 1e-9) / PROTOCOL.stability.limit_cycle)
    lasting = max(decades / 3.0, 0.0) if (ratio or 0.0) > PROTOCOL.stability.ring_down else 0.0
    large = 0.3 + (decades - 1.7) / 2.0 if decades > 1.7 else 0.0
    return min(max(lasting, large), 1.0)


class Tuning:
    """Candidates on all ``arms``, with one process for each core; the stability tests are those that are worst at the
    ``start``."""

    def __init__(self, arms: Sequence[Arm], start: Mapping[str, float]) -> None:
        pairing = STRICT.prepared(Controller.built_in("RobustLQG"))[1]
        fmus = (pairing.plant, pairing.controller)
        self.pool = ProcessPoolExecutor(available_cores(), initializer=begin, initargs=fmus)
        tests = tested()
        found = (each.measurements.limit_cycle for each in self.judged(list(map(simulated, tests)), start))
        ends = [math.inf if amplitude is None else amplitude for amplitude in found]
        worst = sorted(range(len(tests)), key=lambda place: -ends[place])
        self.arms = (*arms, *forced(), *(tests[place] for place in worst[:STABILITY_TESTS]))
        self.cases = list(map(simulated, self.arms))

    def judged(self, cases: Sequence[Case], parameters: Mapping[str, float]) -> Iterable[Judgement]:
        """Simulate cases with a candidate."""
        return self.pool.map(judged, cases, [parameters] * len(cases), chunksize=3)

    def __call__(self, parameters: Mapping[str, float]) -> Judged:
        """Judge one candidate."""
        return summed(self.arms, self.judged(self.cases, parameters))


def repaired(
    start: Mapping[str, float], vary: Sequence[str], arms: Sequence[Arm], generations: int, sigma: float, seed: int
) -> dict[str, float]:
    """The best parameters that CMA-ES finds, which varies the logarithms of those named in ``vary``."""
    tuning = Tuning(arms, start)
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
    parser.add_argument(
        "--vary", default="", metavar="PREFIX", help="parameters that begin with one of these, with commas"
    )
    parser.add_argument("--known", type=Path, nargs="*", default=(), metavar="FOLDER", help="searches to begin with")
    given = parser.parse_args()
    parameters: dict[str, float] = json.loads(FILE.read_text(encoding="utf-8"))["parameters"]
    prefixes = tuple(given.vary.split(","))
    chosen = (name for name in parameters if name.startswith(prefixes) and name.partition("[")[0] not in KEPT)
    vary = [name for name in chosen if parameters[name] > 0.0]
    known = list(given.known)
    for number in range(given.rounds):
        if not known:
            attacked(parameters, given.budget, RUNS / "begin")
            known.append(RUNS / "begin")
        arms = [arm for folder in known for arm in arms_of(Robustness.load(folder))]
        parameters = repaired(parameters, vary, arms, given.generations, given.sigma, given.seed + number)
        found = attacked(parameters, given.budget, RUNS / f"round-{number}")
        print(f"round {number}: V found {found.cost:.1f}, {found.broken or 'no failure found'}", flush=True)
        known.append(RUNS / f"round-{number}")
        how = {**origin(Path(__file__)), "budget": given.budget, "V found": float(f"{found.cost:.4g}")}
        FILE.write_text(json.dumps({"tuned": how, "parameters": parameters}, indent=1) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
