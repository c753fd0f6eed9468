"""What each build of plant and PID costs: in Python as pythonfmu steps it, in Python as machine code, in C.

    python benchmarks/builds.py               every case of `quick` with each pair, in turn
    python benchmarks/builds.py --rounds 9

Needs a C compiler. Processor time of one process that simulates and judges all cases, start and end of each simulation
included; ratios are formed within a round, in which all run one after the other, and medians are printed. The exit code
is 1 if two builds give results that differ in any bit.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Sequence
from pathlib import Path

sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from benchmarks.common import measure, median  # noqa: E402
from orchestrator import Benchmark  # noqa: E402
from orchestrator.benchmark.metrics import judge  # noqa: E402
from orchestrator.benchmark.results import Judgement  # noqa: E402
from orchestrator.fmi.archive import open_archive  # noqa: E402
from orchestrator.fmi.slaves import Slave, load  # noqa: E402
from orchestrator.fmi.slaves.co_simulation import Fmi2CoSimulation  # noqa: E402
from orchestrator.loop.master import simulate  # noqa: E402
from orchestrator.pairing.built_in import built_in  # noqa: E402

PYTHON, MACHINE_CODE, C = "pythonfmu", "machine code", "C"
NAMES = {"plant": ("FlexibleManipulator", "FlexibleManipulatorNative"), "PID": ("DiagonalPID", "DiagonalPID_C")}

PAIRS = (
    *((build, build) for build in (PYTHON, MACHINE_CODE, C)),
    *((plant, C) for plant in (PYTHON, MACHINE_CODE)),  # as for a controller with a binary of its own
)


def builds(kind: str) -> dict[str, Slave]:
    """The builds of "plant" or "PID", loaded."""
    own, in_c = (open_archive(built_in(name)) for name in NAMES[kind])
    return {PYTHON: Fmi2CoSimulation(own), MACHINE_CODE: load(own), C: load(in_c)}


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5, help="how often each runs (default: 5)")
    rounds = parser.parse_args(arguments).rounds
    quick, plants, controllers = Benchmark("quick"), builds("plant"), builds("PID")
    found: dict[str, list[Judgement]] = {}

    def run(name: str, plant: Slave, controller: Slave) -> float:
        begin = time.process_time()
        judged = [judge(quick.rules, case, simulate(plant, controller, case.scenario)) for case in quick.cases]
        found[name] = [each.judgement for each in judged]
        return time.process_time() - begin

    contenders = {
        f"plant {p}, PID {c}": (lambda p=p, c=c: run(f"{p}, {c}", plants[p], controllers[c])) for p, c in PAIRS
    }
    results = measure(contenders, rounds)
    slowest, fastest = (f"plant {build}, PID {build}" for build in (PYTHON, C))
    print("     s   of pythonfmu   of C")
    for name in contenders:
        cost, *ratios = (
            median(results, lambda times, of=of: times[name] / of(times))  # noqa: B023
            for of in (lambda _: 1.0, lambda times: times[slowest], lambda times: times[fastest])
        )
        print(f"{cost:6.2f}   {ratios[0]:12.3f}   {ratios[1]:4.2f}   {name}")
    equal = all(judged == found[f"{C}, {C}"] for judged in found.values())
    print("all give the same bits" if equal else "THE RESULTS DIFFER")
    return 0 if equal else 1


if __name__ == "__main__":
    code = main()
    sys.stdout.flush()
    os._exit(code)  # pythonfmu's libraries must not be torn down with the interpreter
