"""The LQG controllers in Python and their twin in C: the cases of a protocol that differ in any bit.

    python benchmarks/lqg_twins.py                     on ``paper`` (some minutes)
    python benchmarks/lqg_twins.py --protocol quick

Needs a C compiler. For each controller the values of V are printed, how many cases differ, and which.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

from orchestrator import Benchmark, Controller  # noqa: E402
from orchestrator.codec import to_json  # noqa: E402
from orchestrator.pairing.controller import in_c  # noqa: E402

TWIN = "DitheredLQG_C"
CONTROLLERS = {"DitheredLQG": {}, "ManipulatorLQG": {"amplitude[1]": 0.0, "amplitude[2]": 0.0}}
"""The controllers in Python, and what the parameters of the twin in C are set to beside their own."""


def main() -> None:
    """Run the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--protocol", default="paper", metavar="NAME", help="name or file (default: paper)")
    benchmark = Benchmark(parser.parse_args().protocol)
    for name, values in CONTROLLERS.items():
        own = Controller.built_in(name)
        twin = in_c(own, Controller.built_in(TWIN)).with_parameters(values)
        here, there = (benchmark.evaluate(controller, recordings=False) for controller in (own, twin))
        pairs = list(zip(here.cases, there.cases, strict=True))
        other = [case.id for case, another in pairs if to_json(case) != to_json(another)]
        print(f"{name}: V = {here.cost!r} in Python, {there.cost!r} in C")
        print(f"{len(other)} of {len(pairs)} cases differ: {', '.join(other) or 'none'}", flush=True)


if __name__ == "__main__":
    main()
